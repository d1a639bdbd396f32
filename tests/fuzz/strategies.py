"""Strategies of hypothesis for wrong files: texts, values in mappings, arrays, and other things in
the place of a file.
"""

import copy
import io
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from hypothesis import strategies as st
from numpy.typing import NDArray

TOKENS = (
    b"", b" ", b"\n", b"\t", b"\r\n", b"\0", b"\x1b[2J", b"\xff", b"\xe9", "é\u202e".encode(), b"nan",  # noqa: E501
    b"1e300", b"-1e300", b"1e-300", b"1e10", b"1.7e12", b"0", b"-1", b"true", b"null", b"-", b'"', b"'", b"[", b"]", b"{", b"}",  # noqa: E501
    b":", b": ",
    b",", b"#", b"&a", b"*a", b"!!", b"|", b">", b"?", b"%", b"@", b"[/b]", b"[link=x]", b"<b>", b"inf", b".inf", b".nan", b"-inf",  # noqa: E501
    b"9" * 5000, b"x" * 5000, b"[" * 3000, b"{a: " * 500, b"- " * 500, b"1," * 3000, b"\n" * 3000, b"\xff" * 5000, b"a: *a\n",  # noqa: E501
)  # fmt: skip
"""The tokens that are put into a text, or in the place of a part of it."""
VALUES: tuple[Any, ...] = (
    None, True, False, "", "x", "12", "\x1b[2J\ncalib: all is well", "y" * 5000, 0, 1, -1, 3, 10**30, 0.5, -0.0, 1e-300, 1e300, -1e300,  # noqa: E501
    float("nan"), float("inf"), [], {}, [1], [1, 2], ["a", None], [[1.0, 2.0]] * 3, {"value": 25, "sigma": 1e300},  # noqa: E501
    {"value": 25, "sigma": 0},
    {"a": {"b": [1]}}, [0] * 3000, 10**6,
)  # fmt: skip
"""The values that take the place of a value."""


WORDS = (
    "", " ", "-", "--", "--x", "--json", "-o", "-1", "0", "1", "2", "1.5", "1e308", "1e-300", "nan", "inf", "-inf", "9" * 5000, "x" * 5000,  # noqa: E501
    "\x1b[2J", "caf\udce9", "gnp\u202e.exe", "９", "²", "9x6", "9x", "x9", "3x3", "1000x1000", "0x0", "99999999999999999999x9", "auto",  # noqa: E501
    "none", "all", "lens,lens", "radius,", ",", "[/b]", "[link=x]", "%", "%(prog)s", "{}", "~", "a\nb", "absent.png", "folder:", "folder:.",  # noqa: E501
    "video:x", "v4l2:", "v4l2:/dev/null", "folder:absent?speed=nan", "libcamera:\x1b",
)  # fmt: skip
"""The words that take the place of a word of a command line, or stand beside it."""
NUMBERS = (
    "0",
    "0.001",
    "0.05",
    "0.3",
    "0.5",
    "0.9",
    "1",
    "2",
    "3",
    "7",
    "64",
    "1000",
    "1e9",
    "1e308",
    "1e-300",
    "inf",
    "nan",
    "-1",
    "-0.0",
)
"""The numbers that take the place of a number of a command line: more of these are accepted, and
reach the code behind the arguments.
"""


@st.composite
def lines(draw: st.DrawFn, good: Sequence[Sequence[str]]) -> list[str]:
    """A good command line with one or two of its words, but the first two, replaced, dropped,
    doubled, or moved.
    """
    words = list(draw(st.sampled_from(good)))
    for _ in range(draw(st.integers(1, 2))):
        if len(words) == 2:
            break
        at = draw(st.integers(2, len(words) - 1))
        match draw(st.integers(0, 7)):
            case 0:
                del words[at]
            case 1:
                words.insert(at, words[at])
            case 2:
                words.insert(2, words.pop(at))
            case 3:
                words.insert(at, draw(st.sampled_from(WORDS)))
            case 4 | 5 | 6 if words[at].replace(".", "").isdecimal():
                words[at] = draw(st.sampled_from(NUMBERS))
            case _:
                words[at] = draw(st.sampled_from(WORDS))
    return words


@st.composite
def texts(draw: st.DrawFn, good: Sequence[bytes]) -> bytes:
    """A good text with a few of its parts cut, doubled, moved, or replaced by a token."""
    data = draw(st.sampled_from(good))
    for _ in range(draw(st.integers(1, 4))):
        start = draw(st.integers(0, len(data)))
        end = min(len(data), start + draw(st.sampled_from((0, 0, 1, 1, 2, 5, 30, 400))))
        match draw(st.integers(0, 5)):
            case 0:
                data = data[:start]
            case 1:
                data = data[:start] + data[start:end] * 3 + data[end:]
            case 2:
                data = (
                    data[:start]
                    + bytes(byte ^ (1 << draw(st.integers(0, 7))) for byte in data[start:end][:5])
                    + data[end:]
                )
            case _:
                data = data[:start] + draw(st.sampled_from(TOKENS)) + data[end:]
    return data


@st.composite
def mappings(draw: st.DrawFn, good: Mapping[str, Any]) -> dict[str, Any]:
    """A good mapping with a few values, at any depth, replaced, removed or put under another
    key.
    """
    spoilt = copy.deepcopy(dict(good))
    for _ in range(draw(st.integers(1, 3))):
        place: Any = spoilt
        while True:
            keys = list(place) if isinstance(place, dict) else list(range(len(place)))
            if not keys:
                break
            key = draw(st.sampled_from(keys))
            if isinstance(place[key], dict | list) and draw(st.integers(0, 4)):
                place = place[key]
                continue
            match draw(st.integers(0, 5)):
                case 0:
                    del place[key]
                case 1 if isinstance(place, dict):
                    place[draw(st.sampled_from(("x", "\x1b]0;x\x07", "z" * 3000, f"{key}s")))] = (
                        place.pop(key)
                    )
                case _:
                    place[key] = copy.deepcopy(draw(st.sampled_from(VALUES)))
            break
    return spoilt


@st.composite
def arrays(draw: st.DrawFn, good: Mapping[str, NDArray[Any]]) -> dict[str, NDArray[Any]]:
    """Good arrays, one or two of them of another shape, kind or content."""
    held = dict(good)
    for name in draw(st.lists(st.sampled_from(sorted(good)), min_size=1, max_size=2)):
        array = held.get(name, np.zeros(0))
        match draw(st.integers(0, 9)):
            case 0:
                held.pop(name, None)
            case 1:
                held[name] = array[: len(array) // 2] if array.ndim else array
            case 2:
                held[name] = array.reshape(-1)
            case 3:
                held[name] = np.zeros_like(array)
            case 4:
                held[name] = (
                    array.astype(draw(st.sampled_from(("f4", "i8", "U8", "c16", "?"))), copy=True)
                    if array.dtype.kind == "f"
                    else array
                )
            case 5:
                held[name] = np.array(draw(st.sampled_from((0.0, "x", True))))
            case 6 if array.dtype.kind == "f":
                held[name] = array * draw(st.sampled_from((-1.0, 1e-300, 1e8, 1e200)))
            case _ if array.dtype.kind == "f" and array.size:
                held[name] = array.copy()
                held[name].flat[draw(st.integers(0, array.size - 1))] = draw(
                    st.sampled_from((np.nan, np.inf, -np.inf, 1e300, -1.0, 0.0, 1e9))
                )
            case _:
                held[name] = array[::-1] if array.ndim else array
    return held


@st.composite
def corner_views(draw: st.DrawFn, good: NDArray[np.float64]) -> NDArray[np.float64]:
    """Good corners, (views, corners, 2) px, made degenerate: no camera and no poses explain them,
    or many do.
    """
    corners = good.copy()
    views, count = corners.shape[:2]
    for _ in range(draw(st.integers(1, 2))):
        selected = (
            slice(None) if draw(st.booleans()) else slice(draw(st.integers(0, views - 1)), None)
        )
        centre = corners[selected].mean((0, 1))
        match draw(st.integers(0, 9)):
            case 0:  # the same in every view
                corners[selected] = corners[draw(st.integers(0, views - 1))]
            case 1:  # all in one place
                corners[selected] = draw(st.sampled_from((0.0, 100.0)))
            case 2:  # on one line
                corners[selected, :, 1] = draw(st.sampled_from((1.0, 120.0)))
            case 3:  # small, large, flat, or mirrored
                corners[selected] = centre + (corners[selected] - centre) * draw(
                    st.sampled_from(
                        ((1e-3, 1e-3), (0.1, 0.1), (1.0, 1e-2), (-1.0, 1.0), (1e-9, 1.0))
                    )
                )
            case 4:  # in another order
                corners[selected] = corners[selected, ::-1]
            case 5:
                corners[selected] = corners[selected][
                    :, np.random.default_rng(1).permutation(count)
                ]
            case 6:  # noise
                sigma = draw(st.sampled_from((0.01, 1.0, 30.0)))
                noise = np.random.default_rng(draw(st.integers(0, 9))).normal(0, sigma, good.shape)
                corners[selected] += noise[selected]
            case 7:  # few are seen
                corners[selected, draw(st.sampled_from((0, 4, 7, 8, 9, 20))) :] = np.nan
            case 8:  # a grid without perspective, turned towards the camera
                columns, row_index = np.meshgrid(np.arange(6.0), np.arange(5.0))
                corners[selected] = 20 + 30 * np.stack([columns, row_index], -1).reshape(-1, 2)
            case _:
                corners[selected] += draw(st.sampled_from((-100.0, 100.0, 1e4)))
    return corners


@st.composite
def npys(draw: st.DrawFn) -> bytes:
    """A .npy whose header says anything."""
    buffer = io.BytesIO()
    np.save(buffer, np.zeros((4, 5), np.uint8))
    shape = draw(
        st.sampled_from(
            (
                "(4, 5)",
                "(1000000, 1000000)",
                "(-4, 5)",
                "(10**9,)",
                "()",
                "(4, 5, 9, 9)",
                "(99999999999999999999, 1)",
                "4",
                "(2, True)",
            )
        )
    )
    kind = draw(
        st.sampled_from(
            (
                "|u1",
                "<u2",
                ">u2",
                "<f4",
                "<f8",
                "|O",
                "<U99",
                "|V3",
                "<c16",
                "<M8[s]",
                "u9",
                "",
                "|S0",
            )
        )
    )
    header = (
        f"{{'descr': {kind!r}, 'fortran_order': {draw(st.sampled_from(('False', 'True', '3')))},"
        f" 'shape': {shape}, }}".encode()
    )
    version = draw(st.sampled_from(((1, 0), (2, 0), (3, 0), (9, 9))))
    length = len(header).to_bytes(2 if version[0] == 1 else 4, "little")
    return b"\x93NUMPY" + bytes(version) + length + header + buffer.getvalue()[-20:]
