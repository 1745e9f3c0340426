"""For programs: a photo or clip with its options in one request."""

from __future__ import annotations

from starlette.datastructures import FormData, UploadFile
from starlette.requests import Request
from starlette.responses import JSONResponse, Response

from unshutter.options import Rectify
from unshutter.serve.answers import motion_answer, picture_answer
from unshutter.serve.desk import desk_of
from unshutter.serve.fields import read, read_clip
from unshutter.serve.requests import check_clips_can_be_opened, files_of, form_of, texts_of
from unshutter.serve.savings import savings_of
from unshutter.serve.store import OpenFile


async def rectify(request: Request) -> Response:
    """``POST /api/rectify``: multipart form -> the picture."""
    desk = desk_of(request)
    async with form_of(request) as form, files_of(desk, form, "photo", "before", "after", keep=True) as files:
        wanted = read(_options(form, files), desk.photo_path).rectify
        motion = form.get("motion")
        if isinstance(motion, UploadFile):
            file = files["photo"].path.with_name("given.json")
            file.write_bytes(await motion.read())
            wanted = Rectify.of(wanted.find, file, wanted.undo, wanted.save, wanted.neighbours)
        return await picture_answer(desk, files["photo"], wanted, tuple(files.values()))


async def estimate(request: Request) -> Response:
    """``POST /api/estimate``: multipart form -> the motion as JSON."""
    desk = desk_of(request)
    async with form_of(request) as form, files_of(desk, form, "photo") as files:
        return await motion_answer(desk, files["photo"], read(_options(form, files), desk.photo_path))


async def video(request: Request) -> Response:
    """``POST /api/video``: multipart form -> the id of a saving, from which the whole clip is fetched."""
    check_clips_can_be_opened()
    async with form_of(request, "clip") as form, files_of(desk_of(request), form, "clip", keep=True) as files:
        item = files["clip"], read_clip(texts_of(form))
        saving = savings_of(request).begin("file", [item], tuple(files.values()))
        return JSONResponse(saving.as_json(), 202)


def _options(form: FormData, files: dict[str, OpenFile]) -> dict[str, str]:
    """The form's options; photos of this form are named by their ids."""
    return texts_of(form) | {name: file.id for name, file in files.items() if name != "photo"}
