/* A turn on the spot (chapter 00): a room with a post, drawn by a robot that may have the wrong idea of its LiDAR's place. */
(function (root) {
  "use strict";
  const {core, draw, picture} = root.pfslam;
  const EVERY = 5, RADIANS = Math.PI / 180, HANDLE = 0.8;  // degrees; m from the robot to the knob that turns it

  picture("turn", ({room: [x0, x1, y0, y1], post, place, arm, beams, ways}) => {
    const walls = [[x0, y0, x1, y0], [x1, y0, x1, y1], [x1, y1, x0, y1], [x0, y1, x0, y0]];
    const angles = Float64Array.from(beams, degrees => degrees * RADIANS);
    const assumed = {"no lever arm": [0, 0], "lever arm on y": [arm[1], arm[0]]};
    /** The points of one scan at a heading, brought to the world in one of the ways. */
    function scan(way, heading) {
      const pose = [...place, heading], [dx, dy] = assumed[way] || arm;
      const ranges = core.castRays(walls.flat(), post, [...core.transformPoints(pose, arm), heading], angles);
      const points_b = new Float64Array(2 * ranges.length);
      ranges.forEach((r, k) => points_b.set([dx + r * Math.cos(angles[k]), dy + r * Math.sin(angles[k])], 2 * k));
      return Array.from(core.transformPoints(way === "inverse pose" ? core.between(pose, [0, 0, 0]) : pose, points_b));
    }
    const scans = {};
    const points = (way, turned) => Array.from({length: Math.floor(turned / EVERY) + 1}, (_, k) => {
      const key = `${way} ${k}`;
      return (scans[key] = scans[key] || scan(way, k * EVERY * RADIANS));
    }).flat();
    return {
      help: "Drag the ring round the robot. Keys: left and right turn the robot.",
      keys: {ArrowLeft: ["turned", 1], ArrowRight: ["turned", -1]},
      label: "The whole room, and the post from near, as the robot draws them while it turns",
      controls: {
        way: {name: "Drawn with", options: Object.fromEntries(ways.map(way => [way, way])), value: ways[1]},
        turned: {name: "Turned by", min: 0, max: 360, step: EVERY, value: 0, unit: "°", digits: 0},
      },
      play: {key: "turned", seconds: 6},
      places: {wide: [[0, 0, 0.6, 1], [0.6, 0, 0.4, 1]], narrow: [[0, 0, 1, 0.55], [0, 0.55, 1, 0.45]]},
      compute({way, turned}) {
        const drawn = points(way, turned), heading = turned * RADIANS, knob = core.transformPoints([...place, heading], [HANDLE, 0]);
        const to = (x, y) => ({turned: turned + core.wrapAngle(Math.atan2(y - place[1], x - place[0]) - heading) / RADIANS});
        const beyond = drawn.reduce((most, at, k) => Math.max(most, ...(k % 2 ? [at - y1, y0 - at] : [at - x1, x0 - at])), 0);
        const panel = (size, more) => ({
          equal: true, ...more,
          paint(pen, colours) {
            draw.line(pen, walls.flat(), colours.muted, {width: 5, gaps: true});
            const [px, py] = pen.at(post[0], post[1]);
            Object.assign(pen.context, {strokeStyle: colours.muted, lineWidth: 4});
            pen.context.beginPath();
            pen.context.arc(px, py, post[2] * pen.scale, 0, 2 * Math.PI);
            pen.context.stroke();
            draw.dots(pen, drawn, colours.hits, size);
            draw.line(pen, [...place, ...knob], colours.truth, {width: 1.5, dash: [4, 4]});
            draw.robot(pen, [...place, heading], colours.truth);
            draw.knob(pen, knob, colours, "truth");
          },
        });
        return {
          panels: [
            panel(1.2, {title: `turned by ${turned}°`, x: [-1.8, 3.8], y: [-1.8, 2.8], xName: "x [m]", yName: "y [m]",
                        grip: [...knob, ...knob], to}),
            panel(2, {title: "the post", x: [1.65, 2.35], y: [0.85, 1.55], xName: "x [m]", xTicks: {1.8: "1.8", 2.2: "2.2"},
                      yTicks: {1.0: "1.0", 1.4: "1.4"}}),
          ],
          points: drawn, line: "Drag the ring round the robot, and it turns on the spot.",
          words: `A room with a post, drawn (${way}) by a robot that has turned on the spot by ${turned} degrees. Points lie up to ` +
            `${(100 * beyond).toFixed(0)} cm beyond the walls.`,
        };
      },
    };
  });
})(globalThis);
