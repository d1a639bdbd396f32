"""The texts in figures can be read."""

from itertools import combinations

import numpy as np
from matplotlib.figure import Figure

from calib.report.ink import INK, label_lines, side_by_side


def test_the_levels_of_contours_keep_clear_of_the_border_and_of_each_other() -> None:
    """Contours that crowd at the border and cut off its corners, as the maps' predicted errors
    do.
    """
    figure = Figure((4.0, 3.0))
    (axes,) = side_by_side(figure, [3.0], [0.6])
    x, y = np.meshgrid(np.linspace(-1, 1, 65), np.linspace(-1, 1, 49))
    lines = axes.contour(x, y, x**8 + y**8 + 0.2 * x**2, [0.05, 0.5, 0.9, 1.9], colors=[INK])
    label_lines(axes, lines, marks=np.array([[0.0, 0.5]]))
    figure.draw_without_rendering()
    boxes = [text.get_window_extent() for text in axes.texts]
    assert {text.get_text() for text in axes.texts} >= {"0.05", "0.5"}
    assert all(
        axes.bbox.x0 < b.x0 and b.x1 < axes.bbox.x1 and axes.bbox.y0 < b.y0 and b.y1 < axes.bbox.y1
        for b in boxes
    )
    assert not any(first.overlaps(second) for first, second in combinations(boxes, 2))
    assert not any(box.contains(*axes.transData.transform((0.0, 0.5))) for box in boxes)
