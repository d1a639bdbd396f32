"""The camera's settings that a picture file states in its EXIF, and how they differ between
pictures. A calibration is of one camera with one lens, at one zoom and one focus.
"""

import warnings
from collections.abc import Mapping
from contextlib import suppress

from PIL.ExifTags import IFD
from PIL.Image import Exif

from calib.errors import brief
from calib.io.encoded_picture import JPEG, PNG, jpeg_segments

EXIF_HEAD = b"Exif\0\0"
TIFF = (b"II*\0", b"MM\0*")
CAMERA = {271: "make", 272: "model"}
"""EXIF's tags that name the camera, in a picture's main directory."""
SETTINGS = {
    0xA431: "serial number",
    0xA433: "lens maker",
    0xA434: "lens",
    0xA435: "lens serial number",
    0x920A: "focal length",
    0xA404: "digital zoom",
    0x9206: "focus distance",
}
"""EXIF's tags of the settings that a calibration depends on, in the directory of the exposure."""
UNITS = {"focal length": " mm", "focus distance": " m"}
MAX_NAMES = 40
"""Names of pictures that a sentence lists."""


def camera_settings(data: bytes) -> dict[str, str]:
    """Return what the EXIF of a JPEG, PNG or TIFF file states of the camera and its lens, by the
    words of `SETTINGS`; nothing if it has none, or a damaged one.
    """
    block = _exif_block(data)
    settings: dict[str, str] = {}
    # foreign bytes may make Pillow raise anything, and a picture without EXIF is as good
    with suppress(Exception), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        exif = Exif()
        exif.load(block)
        names = [str(exif[tag]).strip(" \0") for tag in CAMERA if tag in exif]
        if camera := " ".join(filter(None, names)):
            settings["camera"] = camera
        details = exif.get_ifd(IFD.Exif)
        for tag, word in SETTINGS.items():
            if text := _text(details.get(tag)):
                settings[word] = text + UNITS.get(word, "")
    return settings


def list_names(names: list[str]) -> str:
    """Return the names of pictures for a sentence; beyond MAX_NAMES, the number of the others."""
    surplus = len(names) - MAX_NAMES
    return ", ".join(names[:MAX_NAMES]) + (f" and {surplus} more" if surplus > 0 else "")


def describe_differences(settings: Mapping[str, Mapping[str, str]]) -> tuple[str, ...]:
    """Return a sentence for each setting in which pictures differ.

    Args:
        settings: for each picture's name, its settings.
    """
    words = dict.fromkeys(word for stated in settings.values() for word in stated)
    sentences = []
    for word in words:
        names_by_value: dict[str, list[str]] = {}
        for name, stated in settings.items():
            if word in stated:
                names_by_value.setdefault(stated[word], []).append(name)
        if len(names_by_value) > 1:
            sentences.append(_describe(word, names_by_value))
    return tuple(sentences)


def _describe(word: str, names_by_value: Mapping[str, list[str]]) -> str:
    """Return the sentence on one setting. The most frequent value comes first, without names."""
    ordered = sorted(names_by_value.items(), key=lambda entry: -len(entry[1]))
    value, names = ordered[0]
    values = [f"{brief(value)} in {len(names)} of them"]
    values += [f"{brief(value)} in {brief(list_names(names))}" for value, names in ordered[1:4]]
    ending = f", and {len(ordered) - 4} more values" if len(ordered) > 4 else ""
    return (
        f"the pictures differ in the {word} that their files state: {', '.join(values)}{ending}. A"
        " calibration is of one camera at one zoom and focus: put the pictures of each into a"
        " folder of its own."
    )


def _text(value: object) -> str:
    """Return a value of EXIF as text; "" if it is unknown: none, 0, or a fraction without a
    denominator.
    """
    if value is None or value == b"" or value != value:  # NaN is a fraction of 0
        return ""
    if isinstance(value, str | bytes):
        text = value.decode(errors="replace") if isinstance(value, bytes) else value
        return text.strip(" \0")
    number = float(value) if hasattr(value, "__float__") else 0.0
    return f"{number:.4g}" if 0 < number < 1e6 else ""


def _exif_block(data: bytes) -> bytes:
    """Return the EXIF of a file as Pillow reads it."""
    if data.startswith(TIFF):
        return EXIF_HEAD + data
    if data.startswith(JPEG):
        for marker, start in jpeg_segments(data):
            if marker == 0xE1 and data[start + 2 : start + 8] == EXIF_HEAD:
                length = int.from_bytes(data[start : start + 2], "big")
                return data[start + 2 : start + length]
            if marker == 0xDA:  # the pixels
                break
    if data.startswith(PNG):
        at = 8
        while at + 12 <= len(data):
            length = int.from_bytes(data[at : at + 4], "big")
            if data[at + 4 : at + 8] == b"eXIf":
                return EXIF_HEAD + data[at + 8 : at + 8 + length]
            at += 12 + length
    return b""
