"""Photos and results behind fsspec URLs: in memory, and on a server that speaks S3 (needs moto[server] and s3fs)."""

import secrets
from collections.abc import Iterator
from pathlib import Path

import pytest

from support.batches import make_photos, rectify, results
from support.drawn_photos import drawn
from support.gain_maps import heic_with_gain_map
from unshutter.photo import Photo
from unshutter.storage.objects import objects_below, path_of, read_object, send

pytest.importorskip("fsspec", reason="needs unshutter[dask]")

NAMES = ["a.jpg", "b.png", "trip/a.jpg", "trip/day 2/c.tif"]
STRAIGHT = ["a.rectified.jpg", "b.rectified.png", "trip/a.rectified.jpg", "trip/day 2/c.rectified.tif"]


@pytest.fixture(scope="module")
def server() -> Iterator[None]:
    pytest.importorskip("s3fs")
    module = pytest.importorskip("moto.server")
    made = module.ThreadedMotoServer("127.0.0.1", port=0)
    made.start()
    host, port = made.get_host_and_port()
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("AWS_ACCESS_KEY_ID", "test")
        patch.setenv("AWS_SECRET_ACCESS_KEY", "test")
        patch.setenv("AWS_DEFAULT_REGION", "us-east-1")
        patch.setenv("AWS_ENDPOINT_URL", f"http://{host}:{port}")
        yield
    made.stop()


@pytest.fixture
def s3(server: None) -> str:
    import boto3

    name = f"archive-{secrets.token_hex(4)}"
    boto3.client("s3").create_bucket(Bucket=name)
    return f"s3://{name}"


@pytest.fixture
def memory() -> Iterator[str]:
    from fsspec.implementations.memory import MemoryFileSystem

    MemoryFileSystem.store.clear()
    yield "memory://archive"
    MemoryFileSystem.store.clear()


@pytest.fixture(params=["memory", "s3"])
def store(request: pytest.FixtureRequest) -> str:
    return request.getfixturevalue(request.param)


def upload(folder: Path, url: str) -> None:
    for path in folder.rglob("*.*"):
        send(path.read_bytes(), path_of(url) / path.relative_to(folder))


def pictures(url: str) -> dict[str, bytes]:
    folder = path_of(url)
    found = [name for name in objects_below(folder) if name.suffix != ".jsonl"]
    return {str(name): read_object(folder / name) for name in found}


def test_a_batch_between_stores_is_resumed(store: str, motion: Path, tmp_path: Path, capsys) -> None:
    make_photos(tmp_path / "archive", NAMES)
    assert rectify(tmp_path / "archive", "-o", tmp_path / "local", "--motion", motion) == 0
    upload(tmp_path / "archive", f"{store}/in")
    send(b"no photo", path_of(f"{store}/in/bad.jpg"))
    assert rectify(f"{store}/in/", "-o", f"{store}/out", "--motion", motion) == 1
    errors = capsys.readouterr().err
    assert "1 of 5 photos failed" in errors
    assert "/in/bad.jpg" in errors
    made = pictures(f"{store}/out")
    assert sorted(made) == STRAIGHT
    assert all(data == (tmp_path / "local" / name).read_bytes() for name, data in made.items())

    assert rectify(f"{store}/in", "-o", f"{store}/out", "--motion", motion) == 1
    assert "4 finished already" in capsys.readouterr().err
    turned = Photo.from_array(Photo.open(tmp_path / "archive/b.png").to_array()[::-1])
    send(turned.to_bytes("png"), path_of(f"{store}/in/b.png"))
    assert rectify(f"{store}/in", "-o", f"{store}/out", "--motion", motion) == 1
    assert "3 finished already" in capsys.readouterr().err
    changed = pictures(f"{store}/out")
    assert {name for name in made if changed[name] != made[name]} == {"b.rectified.png"}


def test_what_others_left_there_is_kept(store: str, motion: Path, tmp_path: Path, capsys) -> None:
    make_photos(tmp_path / "archive", NAMES)
    theirs = path_of(f"{store}/out/a.rectified.jpg")
    send(b"somebody's", theirs)
    assert rectify(tmp_path / "archive", "-o", f"{store}/out", "--motion", motion) == 1
    assert "--overwrite" in capsys.readouterr().err
    assert read_object(theirs) == b"somebody's"
    assert rectify(tmp_path / "archive", "-o", f"{store}/out", "--motion", motion, "--overwrite") == 0
    assert len(read_object(theirs)) > 100


def test_one_object(store: str, motion: Path, tmp_path: Path, capsys) -> None:
    make_photos(tmp_path / "archive", ["a.jpg"])
    upload(tmp_path / "archive", f"{store}/in")
    assert rectify(f"{store}/in/a.jpg", "-o", tmp_path / "a.png", "--motion", motion) == 0
    assert Photo.open(tmp_path / "a.png").format == "png"
    assert rectify(f"{store}/in/a.jpg", "--motion", motion) == 0
    assert sorted(pictures(f"{store}/in")) == ["a.jpg", "a.rectified.jpg"]
    assert rectify(f"{store}/in/a.jpg", "-o", f"{store}/in/a.jpg", "--motion", motion, "--overwrite") == 1
    assert "original" in capsys.readouterr().err
    for missing in (f"{store}/in/none.jpg", f"{store}/nothing"):
        assert rectify(missing, "-o", tmp_path / "out") == 1
        assert capsys.readouterr().err.count("\n") == 1


def test_an_object_with_a_gain_map_says_what_its_avif_loses(memory: str, motion: Path, tmp_path: Path, capsys) -> None:
    send(heic_with_gain_map(drawn(72, 96, 4)), path_of(f"{memory}/in/a.heic"))
    for source in (f"{memory}/in/a.heic", f"{memory}/in"):
        assert rectify(source, "-o", f"{memory}/out", "--motion", motion, "--overwrite") == 0
        assert "not kept: gain map (the result is SDR)" in capsys.readouterr().err
    assert list(pictures(f"{memory}/out")) == ["a.heic.rectified.avif"]


def test_an_unknown_protocol(tmp_path: Path, capsys) -> None:
    assert rectify("nowhere://x/a.jpg", "-o", tmp_path / "out.jpg") == 1
    message = capsys.readouterr().err
    assert message.count("\n") == 1
    assert "nowhere" in message


def test_file_urls_are_files(motion: Path, tmp_path: Path) -> None:
    make_photos(tmp_path / "archive", NAMES)
    url = (tmp_path / "archive").as_uri()
    assert rectify(url, "-o", (tmp_path / "out").as_uri(), "--motion", motion) == 0
    assert sorted(results(tmp_path / "out")) == STRAIGHT


def test_a_cluster_with_a_store(s3: str, motion: Path, tmp_path: Path, capsys) -> None:
    distributed = pytest.importorskip("distributed")
    make_photos(tmp_path / "archive", [f"{k:02}.jpg" for k in range(8)])
    upload(tmp_path / "archive", f"{s3}/in")
    assert rectify(tmp_path / "archive", "-o", tmp_path / "local", "--motion", motion) == 0
    with distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster:
        address = cluster.scheduler_address
        assert rectify(f"{s3}/in", "-o", f"{s3}/out", "--motion", motion, "--scheduler", address) == 0
        made = pictures(f"{s3}/out")
        assert {name: len(data) for name, data in made.items()} == {
            name: (tmp_path / "local" / name).stat().st_size for name in results(tmp_path / "local")
        }
        assert rectify(f"{s3}/in", "-o", f"{s3}/out", "--motion", motion, "--scheduler", address) == 0
    assert "8 finished already" in capsys.readouterr().err
