"""A page with a picture before and after it was straightened, made as it is sent."""

from base64 import b64encode
from html import escape
from pathlib import Path

STRAIGHT = "straight_"
"""The start of the names of folders with straight pictures, before their depth."""
MAX_WIDTH = 1600  # px, which is enough to zoom in on a phone
QUALITY = 90  # JPEG quality
PAGE = """<!doctype html>
<html lang="en">
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>Before and after: {name}</title>
<style>
  :root {{ color-scheme: dark; }}
  body {{ margin: 0; background: #0f172a; color: #f1f5f9; font: 16px/1.4 system-ui, sans-serif; }}
  main {{ display: grid; gap: 8px; padding: 8px; }}
  figure {{ margin: 0; }}
  figcaption {{ padding: 4px 0; overflow-wrap: anywhere; }}
  img {{ display: block; width: 100%; max-height: calc(50vh - 56px); object-fit: contain; }}
  @media (orientation: landscape) {{
    main {{ grid-template-columns: 1fr 1fr; }}
    img {{ max-height: calc(100vh - 60px); }}
  }}
</style>
<main>
  <figure><figcaption><b>Before:</b> {name}, as the camera took it</figcaption>
    <img alt="before" src="{original}"></figure>
  <figure><figcaption><b>After:</b> straight at a depth of {depth}</figcaption>
    <img alt="after" src="{straight}"></figure>
</main>
</html>
"""


def pair_page(original: Path, straight: Path) -> str:
    """Return a page that needs no other file.

    Args:
        original: a picture as the camera took it.
        straight: the same picture in a folder that is named STRAIGHT and the depth.

    Raises:
        DamagedPictureError: one of the pictures cannot be read.
    """
    metres = straight.parent.name.removeprefix(STRAIGHT).removesuffix("m")
    return PAGE.format(
        name=escape(original.name),
        depth=escape(f"{metres} m"),
        original=_data_address(original),
        straight=_data_address(straight),
    )


def _data_address(path: Path) -> str:
    """Return a picture as a data: address, reduced to MAX_WIDTH."""
    # here and not above: a server that nobody asks for a pair loads no OpenCV
    import cv2

    from calib.corners.detect import eight_bits
    from calib.io.images import read_image

    pixels = eight_bits(read_image(path))
    height, width = pixels.shape[:2]
    if width > MAX_WIDTH:
        size = MAX_WIDTH, round(height * MAX_WIDTH / width)
        shown = cv2.resize(pixels, size, interpolation=cv2.INTER_AREA)
    else:
        shown = pixels
    jpeg = cv2.imencode(".jpg", shown, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])[1].tobytes()
    return f"data:image/jpeg;base64,{b64encode(jpeg).decode()}"
