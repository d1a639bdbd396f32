"""The command `calib import`."""

import argparse
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from calib.commands.arguments import add_camera, add_output, millimetres, whole_size
from calib.commands.board_options import add_coding, board_from_options
from calib.commands.cover_options import add_intrinsics, intrinsics_from_options
from calib.commands.printing import print_remark
from calib.commands.termination import exit_on_termination
from calib.errors import InputError, harmless
from calib.io.numerals import counted
from calib.io.shell import shell_path

if TYPE_CHECKING:
    from calib.importing.session_draft import SessionDraft

SUMMARY = "Make a session folder from the pictures or corners of another program."
DESCRIPTION = """
The command never changes a folder that exists already. The new session has no cover: add
yours by options such as calib fit NEW --cover dome --radius 40.
"""
SOURCES_WITH_BOARD = ("mrcal", "photonvision")
"""The sources whose files describe their board: they take no --board."""
SOURCES_WITHOUT_LENS = ("images", "video", "bag")
"""The sources whose files describe no lens: options may state it."""
BOARD_WORDS = "--board 9x6 --square-mm 25"
WHOLE_COMMANDS = {
    "mrcal": "calib import mrcal camera-0.cameramodel -o cam0",
    "photonvision": "calib import photonvision calibration.json -o cam0",
    "mrcal-corners": (
        f"calib import mrcal-corners corners.vnl {BOARD_WORDS} --size 1920x1080 -o cam0"
    ),
    "ros": f"calib import ros calibrationdata.tar.gz {BOARD_WORDS} -o cam0",
    "kalibr": "calib import kalibr FOLDER -o cam0",
    "images": f"calib import images photos {BOARD_WORDS} -o cam0",
    "bag": f"calib import bag recording.bag {BOARD_WORDS} -o cam0",
    "video": f"calib import video film.mp4 {BOARD_WORDS} -o cam0",
}
"""A whole command for each source, for the message on arguments that are missing."""
SINGLE_FILES = {
    "mrcal": "a .cameramodel file",
    "photonvision": "the .json file",
    "mrcal-corners": "the .vnl file of the corners",
    "ros": "the calibrationdata.tar.gz",
    "video": "a video file",
}
"""The file that a source reads, for the message on a folder."""
EXAMPLES = (
    "calib import images photos --board 9x6 --square-mm 25 -o cam0",
    "calib import rig camchain.yaml -o pair",
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    sources = parser.add_subparsers(title="sources", metavar="SOURCE", dest="source", required=True)
    for name, metavar, path_help, words in (
        (
            "mrcal",
            "FILE.cameramodel",
            "the camera model",
            "a camera model with its optimization inputs",
        ),
        (
            "photonvision",
            "FILE.json",
            "the calibration",
            "a calibration of PhotonVision, with its corners",
        ),
        (
            "mrcal-corners",
            "CORNERS.vnl",
            "the corners",
            "corners found by mrgingham or another detector",
        ),
        ("ros", "FILE.tar.gz", "the archive", "the archive of ROS's camera_calibration"),
        (
            "kalibr",
            "FOLDER",
            "the folder that holds camchain.yaml, target.yaml and the pictures",
            (
                "camchain.yaml, target.yaml and the pictures in cam0/, cam1/, ...; checkerboards"
                " and aprilgrids"
            ),
        ),
        ("images", "FOLDER", "the folder of the pictures", "pictures of a board"),
        (
            "bag",
            "FILE",
            "the bag",
            "a bag of ROS 1, a bag or MCAP of ROS 2: its sharpest pictures, spread over its length",
        ),
        (
            "video",
            "FILE",
            "the video",
            "a video of a board: its sharpest frames, spread over its length",
        ),
    ):
        source = sources.add_parser(
            name, help=words, description=f"Import {words}.", example=WHOLE_COMMANDS[name]
        )
        source.add_argument("path", type=Path, metavar=metavar, help=path_help)
        if name not in SOURCES_WITH_BOARD:
            required = name != "kalibr"
            pictured = name in ("ros", "images", "video", "bag")
            tags = ", or a grid's tags" if pictured else ""
            source.add_argument(
                "--board",
                type=whole_size,
                required=required,
                metavar="COLSxROWS",
                help=f"inner corners, columns x rows{tags}",
            )
            source.add_argument(
                "--square-mm",
                type=millimetres,
                required=required and not pictured,
                metavar="MM",
                help="side of a square",
            )
            if pictured:
                add_coding(source)
        if name == "ros":
            source.add_argument(
                "--camera", choices=("left", "right"), help="the camera of a stereo pair"
            )
        if name == "bag":
            source.add_argument(
                "--topic",
                metavar="TOPIC",
                help="the pictures' topic, such as /camera/image_raw, if there are several",
            )
        if name == "kalibr":
            source.add_argument(
                "--camera", metavar="camN", help="the camera, if camchain.yaml describes several"
            )
        if name in SOURCES_WITHOUT_LENS:
            add_intrinsics(source)
        if name in ("images", "mrcal-corners"):
            add_camera(source)
        if name == "mrcal-corners":
            source.add_argument(
                "--size",
                type=whole_size,
                required=True,
                metavar="WxH",
                help="size of the pictures, in px",
            )
        add_output(source, "the new session folder", required=True)
    _add_rig(sources)


def _add_rig(sources: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    summary = (
        "a rig that Kalibr (camchain.yaml), mrcal (a .cameramodel a camera) or OpenCV"
        " (stereo.yml) calibrated, with its pictures"
    )
    rig = sources.add_parser(
        "rig", help=summary, description=f"Import {summary}.", example=EXAMPLES[-1]
    )
    rig.add_argument(
        "path", type=Path, nargs="+", metavar="FILE", help="the files of the calibration"
    )
    rig.add_argument(
        "--pictures",
        type=Path,
        nargs="+",
        default=[],
        metavar="FOLDER",
        help="the pictures of each camera, in the order of the cameras, where the files do not"
        " have them",
    )
    rig.add_argument(
        "--board", type=whole_size, metavar="COLSxROWS", help="inner corners, columns x rows"
    )
    rig.add_argument("--square-mm", type=millimetres, metavar="MM", help="side of a square")
    add_coding(rig)
    add_output(rig, "the new folder with rig.yaml", required=True)


def run(args: argparse.Namespace) -> None:
    from calib.importing.session_draft import check_new, write_session

    check_new(args.output)
    if args.source == "rig":
        _run_rig(args)
        return
    if args.source in SINGLE_FILES and args.path.is_dir():
        raise InputError(f"{args.path}: give {SINGLE_FILES[args.source]}, not a folder.")
    draft = _with_intrinsics(_draft(args), args)
    with exit_on_termination():
        count = write_session(draft, args.output)
    end = _describe_end(args) if args.source == "video" else ()
    for notice in (*draft.notices, *draft.late_notices(), *end):
        print_remark(notice)
    contents = counted(count, "view" if draft.views else "picture")
    advice = f"calibrate it with `calib fit {shell_path(args.output)}`."
    print(harmless(f"{args.output} has {contents}: {advice}"))


def _describe_end(args: argparse.Namespace) -> tuple[str, ...]:
    """Return a sentence if the imported video breaks off."""
    from calib.importing.from_video import describe_end
    from calib.io.images import session_pictures

    return describe_end(args.path, int(session_pictures(args.output)[-1].stem))


def _run_rig(args: argparse.Namespace) -> None:
    from calib.rig.import_rig import import_rig
    from calib.rig.imported_rig import write_rig

    rig = import_rig(args.path, board_from_options(args), args.pictures)
    with exit_on_termination():
        count = write_rig(rig, args.output)
    for name, session in rig.sessions.items():
        for notice in session.notices:
            print_remark(f"{name}: {notice}")
    names = ", ".join(rig.sessions)
    print(
        harmless(
            f"{args.output} has the cameras {names} with {count} pictures or views: describe their"
            f" covers in {args.output}/*/session.yaml, then calibrate with"
            f" `calib rig fit {shell_path(args.output)} -o"
            f" {shell_path(args.output / 'calibration')}`."
        )
    )


def _with_intrinsics(draft: "SessionDraft", args: argparse.Namespace) -> "SessionDraft":
    """Return the draft with the lens that an option states."""
    from calib.session.camera import read_camera
    from calib.session.schema import Section

    intrinsics = intrinsics_from_options(args) if args.source in SOURCES_WITHOUT_LENS else None
    if not intrinsics:
        return draft
    camera = {
        "width": draft.camera.width,
        "height": draft.camera.height,
        "intrinsics": intrinsics,
    }
    return replace(draft, camera=read_camera(Section(camera, "The command line")))


def _draft(args: argparse.Namespace) -> "SessionDraft":
    from calib.importing.from_bag import from_bag
    from calib.importing.from_kalibr import from_kalibr
    from calib.importing.from_mrcal import from_cameramodel, from_corners
    from calib.importing.from_photonvision import from_photonvision
    from calib.importing.from_pictures import from_pictures
    from calib.importing.from_ros import from_ros_archive
    from calib.importing.from_video import from_video

    if args.source == "mrcal":
        return from_cameramodel(args.path)
    if args.source == "photonvision":
        return from_photonvision(args.path)
    board = board_from_options(args)
    if args.source == "kalibr":
        return from_kalibr(args.path, board, args.camera)
    assert board  # the parser requires --board of all sources below
    if args.source == "mrcal-corners":
        return from_corners(args.path, board, args.size, args.camera)
    if args.source == "ros":
        return from_ros_archive(args.path, board, args.camera)
    if args.source == "video":
        return from_video(args.path, board)
    if args.source == "bag":
        return from_bag(args.path, board, args.topic)
    return from_pictures(args.path, board, camera=args.camera)
