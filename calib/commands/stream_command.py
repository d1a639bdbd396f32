"""The command `calib stream`. The package `capture` has the cameras and the screen, and does the
work: this module reaches up to it by its name.
"""

import argparse
from importlib import import_module
from pathlib import Path

from calib.commands.arguments import (
    add_calibration,
    add_crop,
    check_depth_given,
    depth,
    positive_number,
)

WORK = "capture.commands.stream"
"""The module whose `run` does the work."""

SUMMARY = "Straighten a camera's picture live: for programs, a browser, a pipe or the terminal."
DESCRIPTION = """
SOURCE is v4l2:/dev/video0, libcamera:0, rpicam:0, folder:PATH or video:FILE, as for capture; a
camera is opened in the size of the calibration, in colour, and follows the light. TARGET is where
the straight pictures go, and may be given several times.

  v4l2:/dev/videoN   a loopback device, which other programs open as a camera
  http[:PORT]        a page with the picture and its controls, and MJPEG by itself
  -                  stdout, for ffmpeg and GStreamer: y4m, or --pixels raw
  window             this terminal, with keys for depth, crop and scale

A slow reader gets fewer pictures, never old ones: stderr says how old they are and how many were
left out. If the camera is unplugged, the stream waits for it. Ctrl-C ends the stream, and so does
a reader that closes its pipe. With --json the last line is one object: on stdout, or on stderr if
stdout has the pictures.
"""
EXAMPLES = (
    "calib stream out --source rpicam:0 --depth 0.5 --to http",
    "calib stream out --source v4l2:/dev/video0 --depth 0.5 --to v4l2:/dev/video9",
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_calibration(parser)
    parser.add_argument(
        "--source",
        required=True,
        help="the camera, which `capture sources` lists, or a recording",
    )
    parser.add_argument(
        "--depth",
        type=depth,
        metavar="METRES",
        help="how far away the scene is, in metres; with --depth-image, the distance of its"
        " unknown pixels",
    )
    parser.add_argument(
        "--depth-image",
        type=Path,
        metavar="FILE",
        help="a depth for each pixel: metres (npy, tiff) or 16-bit mm (png);"
        " another program may replace it",
    )
    parser.add_argument(
        "--near",
        type=depth,
        default=0.1,
        metavar="METRES",
        help="the smallest depth in the depth image (default: 0.1 m)",
    )
    parser.add_argument(
        "--to",
        action="append",
        required=True,
        metavar="TARGET",
        help="where the straight pictures go, as listed above",
    )
    add_crop(parser)
    parser.add_argument(
        "--scale",
        type=positive_number,
        default=1.0,
        metavar="S",
        help="size divided by the camera's, 0.05 to 4 (default: 1)",
    )
    parser.add_argument(
        "--pixels",
        choices=("y4m", "raw"),
        default="y4m",
        help="with --to -: a video with a header, or the bytes of the pictures, BGR or grey"
        " (default: y4m)",
    )
    parser.add_argument(
        "--rate",
        type=positive_number,
        default=30.0,
        metavar="N",
        help="with --to -: frames a second in y4m (default: 30)",
    )
    parser.add_argument(
        "--host",
        default="127.0.0.1",
        metavar="ADDRESS",
        help="with --to http: the address to serve on (default: %(default)s, this machine alone)",
    )
    parser.add_argument("--json", action="store_true", help="print one JSON object at the end")
    parser.usage = "%(prog)s CALIBRATION --source SOURCE --depth M --to TARGET [options]"


def run(args: argparse.Namespace) -> None:
    check_depth_given(args)
    import_module(WORK).run(args)
