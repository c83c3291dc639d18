/* A dot of light, seen from beside (chapter 06): a wall at a distance, and how far the camera sees a projected dot shift. */
(function (root) {
  "use strict";
  const {draw, picture} = root.pfslam;
  const FAR = 8.4, HANDLE = 0.1;  // m: how far is drawn, and where on the wall the knob is
  const DEPTHS = Array.from({length: 200}, (_, k) => 0.45 + (k * 7.75) / 199);

  picture("dot", ({slope, offset, scale, focal}) => {
    const disparity = z => (scale / z - offset) / slope, strength = Math.abs(scale / slope) / 8, baseline = strength / focal;
    return {
      help: "Drag the wall, or the dot on the curve. Keys: left and right move the wall.",
      keys: {ArrowLeft: ["z", -1], ArrowRight: ["z", 1]},
      label: "From above, a projector, a camera beside it and the dot on a wall; and the raw disparity against depth",
      controls: {z: {name: "Wall at", min: 0.5, max: 8, step: 0.05, value: 1, unit: "m"}},
      play: {key: "z", seconds: 8},
      compute({z}) {
        const shift = strength / z, seen = disparity(z), to = ahead => ({z: ahead});
        const above = {
          title: `shift ${shift.toFixed(1)} px`, x: [-0.4, FAR], y: [-0.035, 0.115], xName: "ahead [m]", yName: "sideways [m]",
          grip: [z, -0.03, z, 0.11], to,
          paint(pen, colours) {
            draw.line(pen, [z, -0.03, z, 0.11], colours.truth, {width: 4});
            draw.line(pen, [0, baseline, z, baseline], colours.hits);
            draw.line(pen, [0, 0, z, baseline], colours.estimate);
            draw.line(pen, [0, 0, FAR, 0], colours.estimate, {width: 1.4, dash: [2, 4]});
            draw.dots(pen, [0, baseline], colours.hits, 6);
            draw.dots(pen, [0, 0], colours.estimate, 6);
            draw.dots(pen, [z, baseline], colours.hits, 7);
            draw.knob(pen, [z, HANDLE], colours, "truth");
            const low = pen.at(0, 0), high = pen.at(0, baseline);
            draw.text(pen, "projector", high[0] + 4, high[1] - 12, colours.hits, {size: 13});
            draw.text(pen, "camera", low[0] + 4, low[1] + 20, colours.estimate, {size: 13});
            draw.text(pen, "to a dot infinitely far", pen.at(FAR, 0)[0] - 4, low[1] + 20, colours.estimate, {size: 13, align: "right"});
          },
        };
        const below = {
          title: `raw disparity ${seen.toFixed(0)}`, x: [-0.4, FAR], y: [300, 1210], xName: "depth Z [m]", yName: "raw disparity d",
          grip: [z, seen, z, seen], to,
          paint(pen, colours) {
            draw.line(pen, [-0.4, 1089, FAR, 1089], colours.truth, {width: 1.2, dash: [2, 4]});
            draw.line(pen, DEPTHS.flatMap(depth => [depth, disparity(depth)]), colours.estimate);
            draw.dots(pen, [z, seen], colours.hits, 7);
            const [right, high] = pen.at(FAR, 1089);
            draw.text(pen, "1089: infinitely far", right - 4, high - 6, colours.ink, {size: 13, align: "right"});
          },
        };
        const line = `Drag the wall. It stands at ${z.toFixed(2)} m.`;
        return {panels: [above, below], line, shift, disparity: seen, words: `A wall at ${z} m. From above: the projector sends one dot ` +
          `straight ahead, the camera ${baseline.toFixed(3)} m beside it sees it ${shift.toFixed(1)} pixels away from where a dot at ` +
          `infinity would be. Below, the raw disparity against depth, rising from 383 at 0.5 m towards 1089: here ${seen.toFixed(0)}.`};
      },
    };
  });
})(globalThis);
