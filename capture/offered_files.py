"""Files that a served app offers to its page: one as it is, several as an archive, which is made
as it is sent and takes neither memory nor disk, or two pictures on a page.
"""

import asyncio
import io
import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from zipfile import ZIP_STORED, ZipFile, ZipInfo

from aiohttp import web

from calib.errors import InputError
from calib.report.scripts import allowed_scripts
from capture.disk import is_regular_file
from capture.picture_pair import pair_page

CHUNK_BYTES = 1 << 16
HEADERS = {
    "Content-Security-Policy": (
        "sandbox allow-scripts; default-src 'none'; style-src 'unsafe-inline'; img-src data:;"
        f" script-src {allowed_scripts()}; frame-ancestors 'none'; base-uri 'none'; form-action"
        " 'none'"
    ),
    "Cache-Control": "no-store",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Referrer-Policy": "no-referrer",
}
"""The headers of these files: a page among them runs no script but those that draw a report's
figures, and is of no origin, so that it reaches nothing else that is served.
"""


async def send_files(request: web.Request, files: Sequence[Path]) -> web.StreamResponse:
    """Answer with the only file, with an archive of several, or with a page of two pictures; 404
    where one is missing.
    """
    if not files or not all(map(is_regular_file, files)):
        return web.Response(status=404)
    if request.path.endswith(".zip"):
        return await _send_archive(request, files)
    if len(files) == 2:
        return await _send_pair(*files)
    return web.FileResponse(files[0], headers=HEADERS)


async def _send_archive(request: web.Request, files: Sequence[Path]) -> web.StreamResponse:
    response = web.StreamResponse(headers={**HEADERS, "X-Content-Type-Options": "nosniff"})
    response.content_type = "application/zip"
    response.headers["Content-Disposition"] = "attachment"
    await response.prepare(request)
    chunks = archive_chunks(files)
    while (chunk := await asyncio.to_thread(next, chunks, None)) is not None:
        await response.write(chunk)
    await response.write_eof()
    return response


async def _send_pair(original: Path, straight: Path) -> web.Response:
    try:
        page = await asyncio.to_thread(pair_page, original, straight)
    except InputError:
        return web.Response(status=404)
    return web.Response(text=page, content_type="text/html", headers=HEADERS)


class _Pending(io.RawIOBase):
    """A file that keeps what was written until it is taken."""

    def __init__(self) -> None:
        super().__init__()
        self._written = bytearray()

    def writable(self) -> bool:
        return True

    def write(self, data: bytes) -> int:  # type: ignore[override]
        self._written += data
        return len(data)

    def take(self) -> bytes:
        taken = bytes(self._written)
        self._written.clear()
        return taken


def archive_chunks(files: Sequence[Path]) -> Iterator[bytes]:
    """Yield a zip archive of these files in pieces, by their names from their common folder on."""
    pending = _Pending()
    folder = Path(os.path.commonpath([file.parent for file in files])).parent
    with ZipFile(pending, "w", ZIP_STORED) as archive:
        for file in files:
            entry = ZipInfo.from_file(file, file.relative_to(folder))
            with file.open("rb") as source, archive.open(entry, "w") as target:
                while chunk := source.read(CHUNK_BYTES):
                    target.write(chunk)
                    yield pending.take()
    yield pending.take()
