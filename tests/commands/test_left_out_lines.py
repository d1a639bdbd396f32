"""Pictures that are not used are listed by their reasons, and counted if they are many."""

from calib.commands.left_out_lines import MAX_NAMES, left_out_lines


def test_a_few_pictures_are_named() -> None:
    pictures = [("a.png", "no board"), ("b.png", "it is damaged"), ("c.png", "no board")]
    assert list(left_out_lines(pictures, "Not used:")) == [
        "Not used: a.png, c.png: no board.",
        "Not used: b.png: it is damaged.",
    ]


def test_a_few_reasons_with_other_numbers_are_told_apart() -> None:
    pictures = [("a.png", "1.2 px do not fit"), ("b.png", "3.4 px do not fit")]
    assert list(left_out_lines(pictures, "Left out")) == [
        "Left out a.png: 1.2 px do not fit.",
        "Left out b.png: 3.4 px do not fit.",
    ]


def test_many_pictures_are_counted() -> None:
    names = [f"{number:03d}.png" for number in range(MAX_NAMES + 17)]
    assert list(left_out_lines([(name, "no board") for name in names], "Not used:")) == [
        "Not used: 20 pictures (000.png, 001.png, 002.png, ...): no board."
    ]
    misfits = [(name, f"{index}.5 px do not fit") for index, name in enumerate(names)]
    assert list(left_out_lines(misfits, "Not used:")) == [
        "Not used: 20 pictures (000.png, 001.png, 002.png, ...), the first: 0.5 px do not fit."
    ]
