"""MP4 files as cameras write them: with boxes, gaps and trailers that no player needs."""

import struct

_NESTED = (b"moov", b"trak", b"mdia", b"minf", b"stbl")


def box(name, content):
    return struct.pack(">I4s", len(content) + 8, name) + content


def boxes(data):
    """(type, position of the box, content) of each box; headers are short."""
    at = 0
    while at + 8 <= len(data):
        size, name = struct.unpack_from(">I4s", data, at)
        yield name, at, data[at + 8 : at + size]
        at += size


def content_of(data, *path):
    for name in path:
        data = next(content for kind, _, content in boxes(data) if kind == name)
    return data


def rebuilt(content, change, path=()):
    """The content of a box: ``change`` gets the path and content of each inside, and returns the new content."""
    out = b""
    for name, _, inner in boxes(content):
        here = (*path, name)
        inner = rebuilt(inner, change, here) if name in _NESTED else inner
        out += box(name, change(here, inner))
    return out


def numbers(table):
    (count,) = struct.unpack_from(">I", table, 4)
    return list(struct.unpack_from(f">{count}I", table, 8))


def chunk_places(data):
    """Where the chunks of all tracks begin, in order."""
    found = []

    def look(path, content):
        if path[-1] == b"stco":
            found.extend(numbers(content))
        return content

    rebuilt(data, look)
    return sorted(found)


def with_offsets(data, place):
    """The file with each chunk's position changed by a function."""

    def change(path, content):
        if path[-1] != b"stco":
            return content
        return content[:8] + b"".join(struct.pack(">I", place(each)) for each in numbers(content))

    return rebuilt(data, change)


def with_gaps(data, gaps):
    """The file with bytes in its ``mdat`` before some chunks: position of a chunk -> bytes; and where they are now."""
    moved = with_offsets(data, lambda old: old + sum(len(gap) for at, gap in gaps.items() if at <= old))
    out = b""
    places = []
    for name, at, content in boxes(moved):
        if name == b"mdat":
            pieces = []
            last = 0
            for gap_at in sorted(gaps):
                inside = gap_at - at - 8
                pieces += [content[last:inside], gaps[gap_at]]
                places.append(at + 8 + sum(map(len, pieces[:-1])))
                last = inside
            content = b"".join([*pieces, content[last:]])
        out += box(name, content)
    return out, places


def with_moov(data, change):
    """The file with the content of ``moov`` changed; it may come before the samples."""
    names = [name for name, _, _ in boxes(data)]
    old = content_of(data, b"moov")
    more = len(change(old)) - len(old)
    if names.index(b"moov") < names.index(b"mdat"):
        data = with_offsets(data, lambda place: place + more)
    return b"".join(box(name, change(content) if name == b"moov" else content) for name, _, content in boxes(data))


def with_entry_boxes(data, extra):
    """The file with boxes added to the film's sample entry."""

    def change(path, content):
        if path[-1] == b"stsd" and content[12:16] in (b"avc1", b"hvc1", b"hev1"):
            (size,) = struct.unpack_from(">I", content, 8)
            entry = content[12:16], content[16 : 8 + size] + extra
            return content[:8] + box(*entry) + content[8 + size :]
        return content

    return with_moov(data, lambda moov: rebuilt(moov, change, (b"moov",)))


def with_box_behind(data, name, extra):
    """The file with another box behind one of its own."""
    at = next(at + 8 + len(content) for kind, at, content in boxes(data) if kind == name)
    moved = with_offsets(data, lambda place: place + len(extra) * (place >= at))
    return moved[:at] + extra + moved[at:]
