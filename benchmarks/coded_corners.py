"""The errors of the corners of boards with markers, in rendered pictures that show them wholly or
in part.

python -m benchmarks.coded_corners
"""

import numpy as np

from calib.corners.detection import Detection
from calib.corners.find import find_board
from fixtures.coded_boards import KINDS, LENS, PARTIAL, WHOLE, poses

BLURS = (0.7, 1.2)  # px
INSIDE = 6.0  # px from the border


def main() -> None:
    for name, kind in KINDS.items():
        for blur in BLURS:
            errors, visible_count = [], 0
            for pose in (WHOLE, PARTIAL, *poses(3, 4, 2 * max(kind.board.half))):
                drawn = kind.view(pose, blur=blur)
                detection = find_board(drawn.picture, kind.board)
                limits = np.array([LENS.width, LENS.height]) - 1 - INSIDE
                visible_count += int(
                    ((drawn.corners >= INSIDE) & (drawn.corners <= limits)).all(1).sum()
                )
                if isinstance(detection, Detection):
                    error = np.linalg.norm(detection.corners - drawn.corners, axis=1)
                    errors.append(error[np.isfinite(error)])
            all_errors = np.concatenate(errors)
            rms, median = np.sqrt((all_errors**2).mean()), np.median(all_errors)
            sentence = (
                f"{rms:.4f} px RMS, {median:.4f} median, {all_errors.max():.3f} most;"
                f" {len(all_errors)} found, {visible_count} inside"
            )
            print(f"{name:12} blur {blur} px: {sentence}")


if __name__ == "__main__":
    main()
