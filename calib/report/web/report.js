// The figures of report.html.

const FIGURES = {
  comparison: drawComparison, scene: drawScene, "side-view": drawSideView, "board-errors": drawBoardErrors, residuals: drawResiduals,
  distortion: drawDistortion, "by-depth": drawByDepth, glass: drawGlass, "glass-detail": drawGlassDetail, sigma: drawSigma, coverage: drawCoverage,
};

addCopyButtons();
wireViews();
drawPage((host, data, name) => FIGURES[name](host, data));
