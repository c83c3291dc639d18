/* A clock that is off blurs what turns see (chapter 08): scans along odometry with shifted stamps, and the cells they need. */
(function (root) {
  "use strict";
  const {core, draw, picture, along} = root.pfslam;

  picture("blur", data => {
    const scans = along(data), {cell, window: [x0, x1, y0, y1]} = data;
    const spec = {origin: [0, 0], resolution: cell};
    return {
      label: "The cells that the walls need, drawn along odometry",
      controls: {shift: {name: "Clock offset", min: -0.25, max: 0.25, step: 0.01, value: 0.1, unit: "s"}},
      tall: [0.68, 1],
      compute({shift}) {
        const cells = new Map();
        for (const points of scans(shift)) {
          const found = core.worldToCell(spec, points);
          for (let k = 0; k < found.length; k += 2) cells.set(found[k] * 65536 + found[k + 1], [cell * found[k], cell * found[k + 1]]);
        }
        const corners = [...cells.values()].flat();
        const panel = {
          title: `${cells.size} cells`, x: [x0, x1], y: [y0, y1], equal: true, xName: "x [m]", yName: "y [m]",
          paint(pen, colours) { draw.dots(pen, corners, colours.truth, 0.45 * cell * pen.scale); },
        };
        return {panels: [panel], count: cells.size, words: `Scans with stamps moved by ${shift.toFixed(2)} s: the walls need ${cells.size} cells.`};
      },
    };
  });
})(globalThis);
