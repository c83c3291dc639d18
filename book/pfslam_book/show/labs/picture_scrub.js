/* The robot drives (chapter 00): what its scans have met so far, and at one moment a scan, an image, wheels and gyro. */
(function (root) {
  "use strict";
  const {core, draw, picture, unpack} = root.pfslam;
  const KEPT = 4, OF = 3;  // of so many scans one stays in the picture from above, and of so many of its points one
  const SOONER = 0.02;  // m: a moment that is a second further off has to be nearer by this

  picture("scrub", data => {
    const [t, speed, yawRate] = [data.t, data.speed, data.yawRate].map(unpack), ranges = data.scans.ranges.map(unpack);
    const images = data.images.sources.map(src => Object.assign(new Image(), {src}));
    const {poses} = data.scans, way = poses.flatMap(([x, y]) => [x, y]);
    const met = ranges.map((scan, k) => core.transformPoints(poses[k], core.scanPoints(scan, data.lidar)));  // in the world
    const few = met.map(points_w => points_w.filter((_, j) => (j >> 1) % OF === 0));
    const nearest = (times, time) => times.reduce((best, one, k) => (Math.abs(one - time) < Math.abs(times[best] - time) ? k : best), 0);
    /** The moment at which the robot was nearest to a place; where its path crosses itself, the nearest in time. */
    function momentAt(x, y, from) {
      const away = poses.map(([px, py], k) => Math.hypot(px - x, py - y) + SOONER * Math.abs(data.scans.t[k] - from));
      return data.scans.t[away.indexOf(Math.min(...away))];
    }
    return {
      help: "Drag the robot along its path, or the line in the curves. Keys: left and right go back and on.",
      keys: {ArrowLeft: ["time", -1], ArrowRight: ["time", 1]},
      label: "The robot from above with what its scans have met; the scan, with ahead at the top; the image; and the curves of wheels and gyro",
      controls: {time: {name: "Time", min: data.from, max: data.to, step: 0.5, value: data.value, unit: "s", digits: 1}},
      play: {key: "time", seconds: 30},
      tall: [0.86, 1.74],
      places: {
        wide: [[0, 0, 0.5, 0.62], [0.5, 0, 0.5, 0.62], [0.06, 0.64, 0.4, 0.36], [0.5, 0.62, 0.5, 0.17], [0.5, 0.79, 0.5, 0.21]],
        narrow: [[0, 0, 1, 0.36], [0, 0.36, 0.55, 0.3], [0.57, 0.41, 0.42, 0.18], [0, 0.65, 1, 0.165], [0, 0.815, 1, 0.185]],
      },
      compute({time}, again) {
        const scan = nearest(data.scans.t, time), points = core.scanPoints(ranges[scan], data.lidar), k = nearest(t, time);
        const shown = nearest(data.images.t, time), image = images[shown], later = 1000 * (data.images.t[shown] - time);
        image.onload = again;
        const turned = core.transformPoints([0, 0, Math.PI / 2], points);  // ahead is up
        const far = Array.from({length: points.length / 2}, (_, j) => Math.hypot(points[2 * j], points[2 * j + 1]));
        const above = {
          title: "from above", x: [-6, 26], y: [-6, 25], equal: true, xName: "x [m]", yName: "y [m]",
          grip: [...poses[scan].slice(0, 2), ...poses[scan].slice(0, 2)], to: (x, y) => ({time: momentAt(x, y, time)}),
          paint(pen, colours) {
            for (let j = 0; j < scan; j += KEPT) draw.dots(pen, few[j], colours.muted, 0.5);
            draw.line(pen, way.slice(0, 2 * scan + 2), colours.truth, {width: 1.5});
            draw.dots(pen, met[scan], colours.hits, 0.8);
            draw.robot(pen, poses[scan], colours.truth, {radius: 0.6});
          },
        };
        const ahead = {
          title: `LiDAR at ${time.toFixed(1)} s`, x: [-5, 5], y: [-3, 7], equal: true, xName: "left, y [m]", yName: "ahead, x [m]",
          xTicks: {"-4": "4", 0: "0", 4: "\u22124"},
          paint(pen, colours) {
            draw.dots(pen, turned, colours.hits, 1.4);
            draw.robot(pen, [0, 0, Math.PI / 2], colours.truth);
          },
        };
        const view = {
          title: Math.abs(later) < 100 ? "camera" : `camera, ${Math.abs(later / 1000).toFixed(1)} s ${later > 0 ? "later" : "earlier"}`, x: [0, 4], y: [0, 3], equal: true, xTicks: null,
          paint(pen) { if (image.complete && image.naturalWidth) pen.context.drawImage(image, ...pen.box); },
        };
        const curve = (values, title, y, more = {}) => ({
          title, x: [0, 125], y, xTicks: {0: "0", 60: "60", 120: "120"}, ...more,
          grip: [time, y[0], time, y[1]], to: x => ({time: x}),
          paint(pen, colours) {
            draw.line(pen, Array.from(t, (one, j) => [one, values[j]]).flat(), colours.odometry, {width: 1});
            draw.line(pen, [time, y[0], time, y[1]], colours.truth, {width: 1.5});
          },
        });
        return {
          panels: [above, ahead, view, curve(speed, "wheels [m/s]", [-0.1, 1.5]), curve(yawRate, "gyro [rad/s]", [-1.7, 1.7], {xName: "time [s]"})],
          points, line: `Drag the robot along its path. Time: ${time.toFixed(1)} s.`,
          words: `At ${time} s: wheels ${speed[k].toFixed(2)} m/s, gyro ${(yawRate[k] < 0 ? "" : "+") + yawRate[k].toFixed(2)} rad/s, nearest ` +
            `LiDAR point ${Math.min(...far).toFixed(1)} m away, farthest ${Math.max(...far).toFixed(1)} m; the image shown was taken ` +
            `${Math.abs(later).toFixed(0)} ms ${later > 0 ? "later" : "earlier"}.`,
        };
      },
    };
  });
})(globalThis);
