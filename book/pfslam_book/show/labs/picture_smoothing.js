/* A smoothed gyro lags behind (chapter 01): the yaw rate averaged over the last moments, and the path that it gives. */
(function (root) {
  "use strict";
  const {core, draw, picture, unpack} = root.pfslam;
  const ABOVE = 0.2;  // rad/s: where, above the curve, the length of the mean is drawn

  picture("smoothing", data => {
    const [v, omega, dt] = [data.v, data.omega, data.dt].map(unpack), {tau, middle} = data, start = [0, 0, 0];
    const times = new Float64Array(dt.length);
    dt.forEach((step, k) => { times[k] = step + (k ? times[k - 1] : 0); });
    const shown = times.findIndex(t => t > middle - 3), until = times.findIndex(t => t >= middle + 3);
    const curve = rates => Array.from({length: until - shown}, (_, k) => [times[shown + k], rates[shown + k]]).flat();
    const raw = core.integrate({v, omega, dt}, start), every = poses => poses.filter((_, k) => Math.floor(k / 3) % 10 === 0 && k % 3 < 2);
    /** The mean of the last `seconds` of rates. */
    function smoothed(seconds) {
      const n = Math.max(Math.round(seconds / tau), 1), means = new Float64Array(omega.length);
      for (let k = 0, sum = 0; k < omega.length; k++) {
        sum += omega[k] - (k >= n ? omega[k - n] : 0);
        means[k] = sum / n;
      }
      return means;
    }
    return {
      help: "Drag the ring: so long is the mean. Keys: left makes it longer, right shorter.",
      keys: {ArrowLeft: ["seconds", 1], ArrowRight: ["seconds", -1]},
      label: "The yaw rate in a turn, raw and smoothed, and the paths of both from above",
      controls: {seconds: {name: "Averaged over the last", min: 0, max: 3, step: 0.05, value: 0.5, unit: "s"}},
      compute({seconds}) {
        const soft = smoothed(seconds), path = core.integrate({v, omega: soft, dt}, start), last = path.length - 1;
        const {ateMax: away} = core.trajectoryError(path, raw), degrees = (Math.abs(path[last] - raw[last]) * 180) / Math.PI;
        const rates = {
          title: `heading at the end ${degrees.toFixed(2)}° apart`, x: [middle - 3, middle + 3], y: [-1.7, 0.4],
          xName: "time [s]", yName: "yaw rate [rad/s]", grip: [middle - seconds, ABOVE, middle - seconds, ABOVE], to: t => ({seconds: middle - t}),
          paint(pen, colours) {
            draw.line(pen, curve(omega), colours.odometry, {width: 0.9});
            draw.line(pen, curve(soft), colours.estimate, {width: 2.5});
            draw.line(pen, [middle - seconds, ABOVE, middle, ABOVE], colours.estimate, {width: 4});
            draw.line(pen, [middle, ABOVE - 0.1, middle, ABOVE + 0.1], colours.estimate);
            draw.knob(pen, [middle - seconds, ABOVE], colours);
            const [x, y] = pen.at(middle - 2.9, -1.6);
            draw.text(pen, "raw", x, y, colours.odometry, {size: 14});
            draw.text(pen, "smoothed", x + 34, y, colours.estimate, {size: 14});
          },
        };
        const paths = {
          title: `path ${away.toFixed(2)} m at most`, x: [-4, 27], y: [-4, 27], equal: true, xName: "x [m]", yName: "y [m]",
          paint(pen, colours) {
            draw.line(pen, every(raw), colours.odometry, {width: 1.8, dash: [5, 4]});
            draw.line(pen, every(path), colours.estimate, {width: 2});
          },
        };
        const line = `Drag the ring: each smoothed rate is the mean of the last ${seconds.toFixed(2)} s.`;
        return {panels: [rates, paths], line, soft, path, degrees, away, words: `Yaw rate averaged over the last ${seconds} s: at the end ` +
          `the heading differs from the raw one by ${degrees.toFixed(2)} degrees, on the way the paths are up to ${away.toFixed(2)} m apart.`};
      },
    };
  });
})(globalThis);
