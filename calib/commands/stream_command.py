"""The command `calib stream`. The package `capture` has the cameras and the screen, and does the
work: this module reaches up to it by its name.
"""

import argparse
from importlib import import_module

from calib.commands.arguments import add_calibration, add_crop, depth, positive_number

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

The newest frame wins: a slow reader gets fewer pictures, never old ones. stderr says how old they
are and how many were passed over. A camera that is unplugged is waited for. Ctrl-C ends the stream,
and so does the reader of a pipe that closes it. With --json the last line is one object: on stdout,
or on stderr if stdout has the pictures.
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
        help="where frames come from; `capture sources` lists the cameras",
    )
    parser.add_argument(
        "--depth",
        type=depth,
        required=True,
        metavar="METRES",
        help="how far away the scene is, in metres",
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
        help="size of the pictures over the camera's, from 0.05 to 4 (default: 1)",
    )
    parser.add_argument(
        "--pixels",
        choices=("y4m", "raw"),
        default="y4m",
        help="of --to -: a video with a header, or the bytes of the pictures, BGR or grey"
        " (default: y4m)",
    )
    parser.add_argument(
        "--rate",
        type=positive_number,
        default=30.0,
        metavar="N",
        help="of --to -: frames a second, which the header of y4m states (default: 30)",
    )
    parser.add_argument(
        "--host",
        default="127.0.0.1",
        metavar="ADDRESS",
        help="of --to http: the address to serve on (default: %(default)s, this machine alone)",
    )
    parser.add_argument("--json", action="store_true", help="print one JSON object at the end")
    parser.usage = "%(prog)s CALIBRATION --source SOURCE --depth M --to TARGET [options]"


def run(args: argparse.Namespace) -> None:
    import_module(WORK).run(args)
