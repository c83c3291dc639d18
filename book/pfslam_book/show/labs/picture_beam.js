/* A beam on squared paper (chapter 02): its end can be dragged, and the cells that it crosses follow. */
(function (root) {
  "use strict";
  const {core, draw, picture} = root.pfslam;
  const COLUMNS = 9, ROWS = 6, START = [0, 0], FINE = 2000;  // cells; so many places along the beam are looked at
  const ticks = n => Object.fromEntries(Array.from({length: n}, (_, k) => [k, `${k}`]));

  /** The cells through which the beam goes at all, each once, as "ix,iy". */
  function touched(end) {
    const cells = Array.from({length: FINE}, (_, k) => START.map((from, axis) => Math.floor(from + (k / (FINE - 1)) * (end[axis] - from) + 0.5)));
    return [...new Set(cells.map(String))];
  }

  picture("beam", ({end: [column, row]}) => ({
    help: "Drag the end of the beam. Keys: the arrows move it by a cell.",
    keys: {ArrowLeft: ["ix", -1], ArrowRight: ["ix", 1], ArrowDown: ["iy", -1], ArrowUp: ["iy", 1]},
    label: "A beam on squared paper: the cells that it crosses, and the one that it hits",
    controls: {
      ix: {name: "End in column", min: 0, max: COLUMNS - 1, step: 1, value: column, digits: 0},
      iy: {name: "End in row", min: 0, max: ROWS - 1, step: 1, value: row, digits: 0},
    },
    tall: [0.64, 0.76],
    compute({ix, iy}) {
      const ray = core.traceRay(START, [ix, iy]), free = Array.from({length: ray.length / 2}, (_, k) => `${ray[2 * k]},${ray[2 * k + 1]}`);
      const cut = touched([ix, iy]).filter(cell => !free.includes(cell) && cell !== `${ix},${iy}`);
      const panel = {
        x: [-0.5, COLUMNS - 0.5], y: [-0.5, ROWS - 0.5], equal: true, xName: "ix", yName: "iy", xTicks: ticks(COLUMNS), yTicks: ticks(ROWS),
        grip: [ix, iy, ix, iy], to: (x, y) => ({ix: Math.round(x), iy: Math.round(y)}),
        paint(pen, colours) {
          for (let k = 0; k < COLUMNS * ROWS; k++) {
            const cell = [k % COLUMNS, Math.floor(k / COLUMNS)], name = String(cell), [x, y] = pen.at(cell[0] - 0.48, cell[1] + 0.48);
            pen.context.fillStyle = name === `${ix},${iy}` ? colours.hits : free.includes(name) ? colours.free
              : cut.includes(name) ? colours.highlight : colours.paper;
            pen.context.fillRect(x, y, 0.96 * pen.scale, 0.96 * pen.scale);
          }
          draw.line(pen, [...START, ix, iy], colours.clear, {width: 2.5});
          draw.dots(pen, START, colours.clear, 6);
          draw.knob(pen, [ix, iy], colours, "hits");
        },
      };
      return {
        panels: [panel], ray, cut: cut.length,
        line: `Drag the end of the beam. Hit: cell (${ix}, ${iy}). Free cells: ${free.length}. Cells that it only cuts: ${cut.length}.`,
        words: `A beam from cell (${START.join(", ")}) to (${ix}, ${iy}), which is hit. Bresenham's line takes ${free.length} cells on the way` +
          `${free.length ? `: (${free.map(cell => cell.replace(",", ", ")).join("), (")})` : ""}. The beam also cuts corners of ${cut.length} other cells.`,
      };
    },
  }));
})(globalThis);
