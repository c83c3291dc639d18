/* Scans with a late clock (chapter 00): eight scans of a straight stretch and of a turn, drawn from the poses of other moments. */
(function (root) {
  "use strict";
  const {draw, picture, along} = root.pfslam;
  const AROUND = 3.5;  // m that are shown around the robot

  /** How far (m, median) a drawn point lies from the nearest of the right ones; every third is asked. */
  function spread(drawn, right) {
    const nearest = [];
    for (let k = 0; k < drawn.length; k += 6) {
      let least = Infinity;
      for (let j = 0; j < right.length; j += 2) least = Math.min(least, (drawn[k] - right[j]) ** 2 + (drawn[k + 1] - right[j + 1]) ** 2);
      nearest.push(Math.sqrt(least));
    }
    nearest.sort((a, b) => a - b);
    const half = nearest.length >> 1;
    return nearest.length % 2 ? nearest[half] : (nearest[half - 1] + nearest[half]) / 2;
  }

  picture("late", ({stretches}) => {
    const known = Object.entries(stretches).map(([name, stretch]) => {
      const scans = along(stretch), at = offset => scans(offset).flatMap(points => [...points]);
      return {name, at, middle: stretch.middle, right: at(0)};
    });
    return {
      label: "Eight scans of a straight stretch, and eight of a turn, over where their points belong",
      controls: {offset: {name: "Clock offset", min: -300, max: 300, step: 5, value: 0, unit: "ms", digits: 0}},
      compute({offset}) {
        const seen = known.map(({name, at, middle: [x, y], right}) => {
          const points = at(offset / 1000), cm = 100 * spread(points, right);
          return {
            name, points, cm, title: `${name}: ${cm.toFixed(0)} cm`, equal: true, xName: "x [m]", yName: "y [m]",
            x: [x - AROUND, x + AROUND], y: [y - AROUND, y + AROUND],
            paint(pen, colours) {
              draw.specks(pen, right, colours.muted, 5);
              draw.specks(pen, points, colours.hits, 2.5);
            },
          };
        });
        const said = seen.map(({name, cm}) => `${name}: in the median a point lies ${cm.toFixed(1)} cm off the walls`);
        return {panels: seen, words: `Eight scans drawn with stamps wrong by ${offset} ms. ${said.join("; ")}.`};
      },
    };
  });
})(globalThis);
