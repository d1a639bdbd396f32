"""Figure: the predicted standard deviation of the maps, at several depths."""

import numpy as np

from calib.apply.map_uncertainty import corner_variances
from calib.report.evidence import Evidence
from calib.report.figure import Drawing

MAX_PANELS = 3


def sigma_caption(evidence: Evidence) -> str:
    return (
        "Predicted sigma (standard deviation) of the undistorted position, x and y together, if"
        " the model is right. It follows from the scatter of the corners and of the views, and"
        " from what was declared. It leaves out a common shift or turn of all rays, which pictures"
        " of a board cannot show."
        " Dots: corners. The number above each panel is the median over the corners."
        + evidence.limit_caption
    )


def predicted_errors(evidence: Evidence) -> Drawing | None:
    """Return None if the fit estimated no covariance."""
    field = evidence.sigma
    if not field:
        return None
    depths = list(evidence.depths[:MAX_PANELS])
    nodes = np.stack(np.meshgrid(field.nodes_x, field.nodes_y), -1)
    near, far = evidence.reach
    return Drawing(
        "sigma",
        "Uncertainty of the maps",
        sigma_caption(evidence),
        {
            "x": field.nodes_x,
            "y": field.nodes_y,
            "variance": np.where(evidence.shows(nodes)[..., None], field.variance, np.nan),
            "atCorners": corner_variances(evidence.calibration),
            "depths": depths,
            "reach": [near, far],
            "limit": max(
                float(np.nanquantile(evidence.sigma_at_nodes(depth), 0.98)) for depth in depths
            ),
        },
    )
