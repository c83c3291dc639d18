/* One turn, and where the LiDAR sits (chapter 13): the walls of a turn for any place of the LiDAR, and the cells they need. */
(function (root) {
  "use strict";
  const {core, draw, picture, unpack} = root.pfslam;
  const LEAST = -0.3, MOST = 0.4, APART = 0.02;  // m: places of the LiDAR, and of the curve's dots
  const AROUND = 2.1, REACH = MOST + 0.1;  // m that are shown around the robot; m beyond which no place moves a point

  /** Cells of points, counted: a cell that was hit is stamped with the number of the count, so that nothing is wiped. */
  function counter(points, cell) {
    const low = [Infinity, Infinity], high = [-Infinity, -Infinity];
    points.forEach(scan => scan.forEach((at, k) => {
      low[k % 2] = Math.min(low[k % 2], at);
      high[k % 2] = Math.max(high[k % 2], at);
    }));
    const origin = low.map(at => Math.floor((at - REACH) / cell)), [width, height] = high.map((at, k) => Math.ceil((at + REACH) / cell) - origin[k]);
    const stamps = new Uint32Array(width * height), spec = {origin: [0, 0], resolution: cell};
    let number = 0;
    return scans => {
      let count = 0;
      number += 1;
      for (const scan of scans) {
        const cells = core.worldToCell(spec, scan);
        for (let k = 0; k < cells.length; k += 2) {
          const at = (cells[k + 1] - origin[1]) * width + cells[k] - origin[0];
          if (stamps[at] !== number) { stamps[at] = number; count += 1; }
        }
      }
      return count;
    };
  }

  picture("lever", ({ranges, poses, lidar, cell}) => {
    const drawn = lidar.position[0], middle = [0, 1].map(axis => poses.reduce((sum, pose) => sum + pose[axis], 0) / poses.length);
    const points_l = ranges.map(scan => core.scanPoints(unpack(scan).map(Math.fround), {...lidar, position: [0, 0]}));
    const mounted = ahead => poses.map(pose => core.compose(pose, [ahead, 0, 0]));
    const walls = ahead => mounted(ahead).map((pose, k) => core.transformPoints(pose, points_l[k]));
    const cellsOf = counter(walls(0), cell);
    const places = Array.from({length: Math.round((MOST - LEAST) / APART) + 1}, (_, k) => LEAST + k * APART);
    const counts = places.map(place => cellsOf(walls(place))), curve = places.flatMap((place, k) => [place, counts[k]]);
    const sharpest = places[counts.indexOf(Math.min(...counts))], top = 1.05 * Math.max(...counts);
    return {
      help: "Drag the ring along the curve. Keys: left and right move the LiDAR.",
      keys: {ArrowLeft: ["ahead", -1], ArrowRight: ["ahead", 1]},
      label: "The cells that the walls of one turn need, for every place of the LiDAR, and the walls for one place",
      controls: {ahead: {name: "LiDAR ahead of the centre by", min: LEAST, max: MOST, step: 0.01, value: -0.2, unit: "m"}},
      tall: [0.55, 1.5],
      places: {wide: [[0, 0, 0.48, 1], [0.48, 0, 0.52, 1]], narrow: [[0, 0, 1, 0.42], [0, 0.42, 1, 0.58]]},
      compute({ahead}) {
        const scans = walls(ahead), count = cellsOf(scans), lidars = mounted(ahead).flatMap(([x, y]) => [x, y]);
        const cloud = new Float64Array(scans.reduce((numbers, points) => numbers + points.length, 0));
        scans.reduce((at, points) => { cloud.set(points, at); return at + points.length; }, 0);
        return {
          panels: [
            {
              title: `${count} cells`, x: [LEAST, MOST], y: [0, top], xName: "LiDAR ahead of the centre by [m]", yName: "cells hit",
              grip: [ahead, count, ahead, count], to: x => ({ahead: x}),
              paint(pen, colours) {
                draw.line(pen, [drawn, 0, drawn, top], colours.muted, {dash: [2, 3]});
                draw.line(pen, curve, colours.ink);
                draw.knob(pen, [ahead, count], colours, "highlight");
              },
            },
            {
              title: "the walls of one turn", equal: true, xName: "x [m]", yName: "y [m]",
              x: [middle[0] - AROUND, middle[0] + AROUND], y: [middle[1] - AROUND, middle[1] + AROUND],
              paint(pen, colours) {
                draw.specks(pen, cloud, colours.hits, 1.5);
                draw.dots(pen, lidars, colours.highlight, 2.5);
              },
            },
          ],
          count, counts, line: `Drag the ring along the curve. The LiDAR sits ${Math.abs(ahead).toFixed(2)} m ${ahead < 0 ? "behind" : "ahead of"} the centre.`,
          words: `Left: cells hit against the place of the LiDAR, least at ${sharpest.toFixed(2)} m; the drawing says ${drawn.toFixed(2)} m. ` +
            `Right: the walls of one turn with the LiDAR ${ahead.toFixed(2)} m ahead of the centre, in ${count} cells.`,
        };
      },
    };
  });
})(globalThis);
