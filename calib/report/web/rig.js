// The figures of a rig's report.html.

const FIGURES = {scene: drawScene};

addCopyButtons();
drawPage((host, data, name) => FIGURES[name](host, data));
