"""The command `capture sources`."""

import argparse
from dataclasses import asdict

SUMMARY = "List the cameras of this machine with their modes, and say what is missing."
DESCRIPTION = """
The first column is the value for --source.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--json", action="store_true", help="print one JSON object")


def run(args: argparse.Namespace) -> None:
    from calib.commands.printing import print_json
    from calib.errors import harmless
    from capture.sources.registry import SCHEMES

    inventories = {scheme.name: scheme.backend().inventory() for scheme in SCHEMES}
    if args.json:
        cameras = [
            asdict(camera) for inventory in inventories.values() for camera in inventory.cameras
        ]
        missing = [
            {"scheme": name, "reason": inventory.missing}
            for name, inventory in inventories.items()
            if inventory.missing
        ]
        print_json({"cameras": cameras, "missing": missing})
        return
    for name, inventory in inventories.items():
        for camera in inventory.cameras:
            print(harmless(f"{camera.source}  {camera.problem or camera.name}"))
            for mode in camera.modes:
                print(harmless(f"    {mode}"))
        if inventory.missing:
            print(f"{name}: {inventory.missing}")
