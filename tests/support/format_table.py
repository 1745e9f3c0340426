"""What is kept of each format, measured on files written on the fly: the tables in docs/reference/formats.md.

``PYTHONPATH=tests python -m support.format_table`` measures and writes them;
test_format_table.py measures them again and compares. Other programs than unshutter write the files and look at the
results (Pillow, OpenCV, libheif, tifffile).
"""

import io
import tempfile
from collections.abc import Callable
from functools import cache
from pathlib import Path

import cv2
import numpy as np
from PIL import Image, ImageCms, IptcImagePlugin
from PIL.JpegImagePlugin import get_sampling

import unshutter
from support.camera_files import heic
from support.drawn_photos import drawn, encoded, textured
from support.gain_maps import ISO_OF_MAP, OF_APPLES_MAP, OF_MAP, hdr_photo, pictures_of, with_tone_map
from support.motion_photos import VIDEO, motion_photo
from support.rich_files import (
    COLUMNS,
    DATE,
    EXIF,
    GPS,
    HEIGHT,
    ICC,
    MAKER_NOTE,
    NOTE,
    ORIENTATION,
    RAW,
    WIDTH,
    file_of,
    rich_file,
)
from support.tagged_files import TITLE, jpeg_thumbnail, png_with_chunks, small_jpeg, with_code_points
from unshutter import RowMotion, UnshutterError

PAGE = Path(__file__).parents[2] / "docs" / "reference" / "formats.md"
BEGIN, END = "<!-- measured: PYTHONPATH=tests python -m support.format_table -->\n", "<!-- end -->"
MOTION = RowMotion.from_polynomials([0, 12], [0, 0.03], HEIGHT, WIDTH)
RESULTS = COLUMNS | {"HEIC": ".avif", RAW: ".tif"}
HDR_BEGIN = "<!-- measured: of HDR -->\n"
OUTPUTS = ("JPEG", "PNG", "WebP", "TIFF", "AVIF")  # columns of the second table
NONE = "–"


def rectified(column: str, data: bytes | None, quality: int | None = None) -> bytes | None:
    """The result, as the command writes it for such a file."""
    if data is None:
        return None
    with tempfile.TemporaryDirectory() as folder:
        path, result = Path(folder, f"photo{COLUMNS[column]}"), Path(folder, f"out{RESULTS[column]}")
        path.write_bytes(data)
        unshutter.rectify(path, motion=MOTION, edges="crop").save(result, quality=quality)
        return result.read_bytes()


@cache
def rich_result(column: str, orientation: int = 6) -> bytes:
    """The result for a photo with everything."""
    return rectified(column, rich_file(column, orientation))


def opened(data: bytes) -> Image.Image:
    """By Pillow, which turns TIFFs when it loads them."""
    picture = Image.open(io.BytesIO(data))
    if picture.format != "TIFF":
        picture.load()
    return picture


# ---- what is measured: each answers with the words of a cell ---------------------------------------------------


def bits(column: str) -> str:
    kept = []
    for depth in (8, 10, 12, 16):
        data = None
        if depth in (8, 16):
            data = file_of(column, drawn(HEIGHT, WIDTH, dtype=np.uint16 if depth == 16 else np.uint8))
        elif column == "AVIF" or (column == "HEIC" and depth == 10):
            options = {"bitdepth": depth} if column == "AVIF" else {}
            data = file_of(column, drawn(HEIGHT, WIDTH, dtype=np.uint16), **options)
        if depth == 16 and column in ("AVIF", "HEIC"):
            continue
        result = rectified(column, data)
        if result is not None:
            kept.append(str(depth) if depth_of(result) == depth else f"{depth} → {depth_of(result)}")
    return ", ".join(kept)


def depth_of(data: bytes) -> int:
    if b"ftypavif" in data[:16]:
        flags = data[data.index(b"av1C") + 6]
        return 8 if not flags & 0x40 else 12 if flags & 0x20 else 10
    pixels = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    return pixels.dtype.itemsize * 8


def grey(column: str) -> str:
    result = rectified(column, file_of(column, drawn(HEIGHT, WIDTH, bands=1)))
    if result is None:
        return NONE
    return "kept" if opened(result).mode in ("L", "LA") else "as RGB"


def alpha(column: str) -> str:
    result = rectified(column, file_of(column, drawn(HEIGHT, WIDTH, bands=4)))
    return NONE if result is None else "kept" if opened(result).mode == "RGBA" else "lost"


def cmyk(column: str) -> str:
    if column not in ("JPEG", "TIFF"):
        return NONE
    try:
        rectified(column, encoded(drawn(HEIGHT, WIDTH, bands=4), column, mode="CMYK"))
    except UnshutterError as error:
        assert str(error).endswith("is in CMYK colours: convert it to RGB first")
        return "refused"
    return "taken"


def camera_and_date(column: str) -> str:
    tags = opened(rich_result(column)).getexif()
    told = (tags.get(0x010F), tags.get(0x0132), tags.get_ifd(EXIF).get(0x9003))
    return "kept" if told == ("Acme", DATE, DATE) else "lost"


def place(column: str) -> str:
    tags = opened(rich_result(column)).getexif().get_ifd(GPS)
    return "kept" if (tags.get(1), tags.get(2)) == ("N", (48.0, 51.0, 29.5)) else "lost"


def makers_note(column: str) -> str:
    source, result = rich_file(column), rich_result(column)
    if opened(result).getexif().get_ifd(EXIF).get(MAKER_NOTE) != NOTE:
        return "lost"
    before, after = (data.index(NOTE) - beginning(data, data.index(NOTE)) for data in (source, result))
    return "kept in its place" if before == after else "kept, moved"


def beginning(data: bytes, at: int) -> int:
    """Where the TIFF structure begins in which something lies."""
    return max(data.rfind(mark, 0, at) for mark in (b"II*\0", b"MM\0*"))


def orientation(column: str) -> str:
    right = 0
    for turn in range(1, 9):
        picture = opened(rich_result(column, turn))
        width, height = stored_size(picture)
        right += picture.getexif().get(ORIENTATION, 1) == turn and width > height
    return f"kept, {right} of 8"


def size_tags(column: str) -> str:
    picture = opened(rich_result(column))
    tags = picture.getexif().get_ifd(EXIF)
    width, height = stored_size(picture)
    assert width < WIDTH
    told = (tags.get(0xA002), tags.get(0xA003), b'tiff:ImageWidth="%d"' % width in xmp_of(picture))
    return "rewritten" if told == (width, height, True) else f"wrong: {told}"


def stored_size(picture: Image.Image) -> tuple[int, int]:
    """Width and height of the stored pixels; Pillow tells a TIFF's as a viewer shows it."""
    return (picture.tag_v2[256], picture.tag_v2[257]) if picture.format == "TIFF" else picture.size


def thumbnail(column: str) -> str:
    result = rich_result(column, 1)
    new, full = jpeg_of_exif(result), opened(result).convert("RGB")
    if new is None:
        return "dropped"
    like = np.abs(np.asarray(new).astype(int) - np.asarray(full.resize(new.size))).mean()
    return "regenerated" if like < 8 else "kept"


def jpeg_of_exif(data: bytes) -> Image.Image | None:
    blob = opened(data).info.get("exif")
    return None if blob is None else jpeg_thumbnail(blob)


def other_thumbnails(column: str) -> str:
    result = rich_result(column)
    return "dropped" if b"xmp:Thumbnails" not in result and small_jpeg()[-100:] not in result else "kept"


def icc(column: str) -> str:
    profile = opened(rich_result(column)).info.get("icc_profile")
    if profile == ICC:
        return "kept"
    name = ImageCms.getProfileDescription(ImageCms.ImageCmsProfile(io.BytesIO(profile))) if profile else "lost"
    return "sRGB" if "sRGB" in name else name.strip()


def xmp(column: str) -> str:
    return "kept" if b'xmp:Rating="4"' in xmp_of(opened(rich_result(column))) else "lost"


def xmp_of(picture: Image.Image) -> bytes:
    return picture.info.get("xmp") or picture.info.get("XML:com.adobe.xmp", "").encode()


def iptc(column: str) -> str:
    if column == "PNG":
        profile = opened(rich_result(column)).info.get("Raw profile type iptc", "")
        return "kept" if TITLE.hex() in "".join(profile.split()) else "lost"
    if column not in ("JPEG", "TIFF", RAW):
        return NONE
    return "kept" if IptcImagePlugin.getiptcinfo(opened(rich_result(column))) else "lost"


def texts(column: str) -> str:
    if column != "PNG":
        return NONE
    return "kept" if opened(rich_result(column)).info.get("Creation Time") == "© Müller" else "lost"


def resolution(column: str) -> str:
    if column not in ("JPEG", "PNG", "TIFF"):
        return NONE
    options = {"resolution_unit": "inch", "x_resolution": 300, "y_resolution": 200} if column == "TIFF" else {}
    data = file_of(column, drawn(HEIGHT, WIDTH), **(options or {"dpi": (300, 200)}))
    told = opened(rectified(column, data)).info.get("dpi", (0, 0))
    return "kept" if [round(float(number)) for number in told] == [300, 200] else "lost"


def comment(column: str) -> str:
    if column != "JPEG":
        return NONE
    kept = opened(rectified(column, file_of(column, drawn(HEIGHT, WIDTH), comment=b"by me"))).info.get("comment")
    return "kept" if kept == b"by me" else "lost"


def video(column: str) -> str:
    if column != "JPEG":
        return NONE
    return "kept" if rectified(column, motion_photo(drawn(HEIGHT, WIDTH))).endswith(VIDEO) else "lost"


def quality(column: str) -> str:
    pixels = textured(HEIGHT, WIDTH)
    if column == "JPEG":
        files = [file_of(column, pixels, quality=number) for number in (30, 75, 92)]
        alike = [opened(file).quantization == opened(rectified(column, file)).quantization for file in files]
        return "like the photo's" if all(alike) else "other"
    if column == "WebP":
        kept = [b"VP8L" in rectified(column, file_of(column, pixels, lossless=lossless)) for lossless in (True, False)]
        return f"lossless stays so, else {told_quality(column, 90)}" if kept == [True, False] else "other"
    if column == "TIFF":
        files = [file_of(column, pixels, compression=name) for name in ("raw", "tiff_lzw", "jpeg")]
        numbers = [opened(rectified(column, file)).tag_v2[259] for file in files]
        return "none, LZW; else deflate" if numbers == [1, 5, 8] else str(numbers)
    if column == RAW:
        return {8: "deflate"}.get(opened(rich_result(column)).tag_v2[259], "other")
    if column == "PNG":
        exact = unshutter.rectify(pixels, motion=MOTION, edges="crop").array
        return "lossless" if np.array_equal(opened(rectified(column, file_of(column, pixels))), exact) else "lossy"
    return told_quality(column, 80)


def told_quality(column: str, expected: int) -> str:
    """The quality that is meant when none is told."""
    data = file_of(column, textured(HEIGHT, WIDTH))
    same = rectified(column, data) == rectified(column, data, quality=expected)
    return (
        str(expected) if same and rectified(column, data, quality=expected + 5) != rectified(column, data) else "other"
    )


def subsampling(column: str) -> str:
    if column not in ("JPEG", "AVIF", "HEIC"):
        return NONE
    cells = []
    for given in ("4:4:4", "4:2:2", "4:2:0"):
        options = {"chroma": int(given.replace(":", ""))} if column == "HEIC" else {"subsampling": given}
        result = rectified(column, file_of(column, drawn(HEIGHT, WIDTH), **options))
        if column == "JPEG":
            after = {0: "4:4:4", 1: "4:2:2", 2: "4:2:0"}[get_sampling(opened(result))]
        else:
            after = {0: "4:4:4", 8: "4:2:2", 12: "4:2:0"}[result[result.index(b"av1C") + 6] & 12]
        cells.append(given if given == after else f"{given} → {after}")
    return ", ".join(cells)


ROWS: dict[str, Callable[[str], str]] = {
    "bits per channel": bits,
    "grey": grey,
    "alpha": alpha,
    "CMYK": cmyk,
    "EXIF: camera, dates": camera_and_date,
    "EXIF: GPS": place,
    "EXIF: maker's note": makers_note,
    "EXIF: orientation": orientation,
    "EXIF and XMP: sizes": size_tags,
    "EXIF: thumbnail": thumbnail,
    "thumbnails in XMP, Photoshop's data": other_thumbnails,
    "ICC profile": icc,
    "XMP": xmp,
    "IPTC": iptc,
    "texts (PNG)": texts,
    "resolution": resolution,
    "comment": comment,
    "video of a motion photo": video,
    "quality or compression": quality,
    "chroma subsampling": subsampling,
}


# ---- kinds of HDR, by the format of the photo and that of the result -------------------------------------------


def coded_hdr(column: str, transfer: int) -> bytes:
    """A photo in PQ (16) or HLG (18), and BT.2020's primaries."""
    pixels = drawn(HEIGHT, WIDTH, dtype=np.uint16)
    if column == "PNG":
        return png_with_chunks(file_of("PNG", pixels), (b"cICP", bytes([9, transfer, 0, 1])))
    if column == "AVIF":
        return with_code_points(encoded(drawn(HEIGHT, WIDTH), "AVIF"), 9, transfer)
    return with_code_points(heic(pixels), 9, transfer)


def transfers(column: str, output: str) -> str:
    kept = []
    for transfer in (16, 18):
        with tempfile.TemporaryDirectory() as folder:
            path, result = Path(folder, f"photo{COLUMNS[column]}"), Path(folder, f"out{COLUMNS[output]}")
            path.write_bytes(coded_hdr(column, transfer))
            try:
                unshutter.rectify(path, motion=MOTION, edges="crop").save(result)
            except UnshutterError as error:
                assert "cannot hold HDR colours" in str(error)
                continue
            data, told = result.read_bytes(), bytes([9, transfer, 0, 1])
            in_box = b"colrnclx" + bytes([0, 9, 0, transfer])
            kept.append(b"cICP" + told in data if output == "PNG" else in_box in data)
    return "refused" if not kept else "kept" if kept == [True, True] else "lost"


def gain_map(column: str, output: str, is_apples: bool = False) -> str:
    """Whether the map's metadata are there, with new pixels."""
    pixels = drawn(HEIGHT, WIDTH, bands=4)
    if column == "JPEG":
        data, told = hdr_photo(HEIGHT, WIDTH, (HEIGHT // 4, WIDTH // 4), iso=b""), OF_MAP
    else:
        files = [file_of(column, each) for each in (pixels[..., :3], pixels[..., 3:])]
        data = with_tone_map(*files, of_apple=OF_APPLES_MAP if is_apples else b"")
        told = OF_APPLES_MAP if is_apples else ISO_OF_MAP
    with tempfile.TemporaryDirectory() as folder:
        path, result = Path(folder, f"photo{COLUMNS[column]}"), Path(folder, f"out{COLUMNS[output]}")
        path.write_bytes(data)
        lacking = unshutter.rectify(path, motion=MOTION, edges="crop").save(result)
        if "gain map (the result is SDR)" in lacking:
            return "SDR"
        if output == "AVIF":
            return "kept" if ISO_OF_MAP in result.read_bytes() else "lost"
        return "kept" if told in pictures_of(result.read_bytes())[1] else "lost"


HDR_ROWS: dict[str, Callable[[str], str]] = {
    "gain map in JPEG": lambda output: gain_map("JPEG", output),
    "gain map in AVIF (ISO)": lambda output: gain_map("AVIF", output),
    "gain map in HEIC (ISO)": lambda output: gain_map("HEIC", output),
    "gain map in HEIC (Apple)": lambda output: gain_map("HEIC", output, is_apples=True),
    "PQ, HLG in PNG": lambda output: transfers("PNG", output),
    "PQ, HLG in AVIF": lambda output: transfers("AVIF", output),
    "PQ, HLG in HEIC": lambda output: transfers("HEIC", output),
}


# ---- the page --------------------------------------------------------------------------------------------------


def measured(column: str, rows: dict[str, Callable[[str], str]] = ROWS) -> dict[str, str]:
    """The cells of a column, by row."""
    return {row: measure(column) for row, measure in rows.items()}


def written(begin: str = BEGIN) -> dict[str, dict[str, str]]:
    """The cells that the page has, by column and row."""
    lines = PAGE.read_text(encoding="utf-8").split(begin)[1].split(END)[0].strip().splitlines()
    head, _, *rows = ([cell.strip() for cell in line.strip("|").split("|")] for line in lines)
    return {name: {row[0]: row[1 + at] for row in rows} for at, name in enumerate(head[1:])}


def main() -> None:
    for begin, columns, rows in ((BEGIN, COLUMNS, ROWS), (HDR_BEGIN, OUTPUTS, HDR_ROWS)):
        cells = {column: measured(column, rows) for column in columns}
        lines = ["| | " + " | ".join(columns) + " |", "|---" * (1 + len(columns)) + "|"]
        lines += [f"| {row} | " + " | ".join(cells[column][row] for column in columns) + " |" for row in rows]
        before, rest = PAGE.read_text(encoding="utf-8").split(begin)
        _, after = rest.split(END, 1)
        PAGE.write_text(before + begin + "\n" + "\n".join(lines) + "\n\n" + END + after, encoding="utf-8")


if __name__ == "__main__":
    main()
