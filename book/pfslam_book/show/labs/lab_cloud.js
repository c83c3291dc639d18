/* The cloud along a drive (chapter 03): prediction alone, along a drive through the building or a way that the reader draws. */
(function (root) {
  "use strict";
  const {core, draw, lab, world} = root.pfslam, {WINDOW, START, LAP, dot} = world;

  const SHOWN = 10, TURN = 1.6, DT = 0.1;  // particles whose whole paths are drawn; of the robot: rad/s, s
  const ELLIPSES = 8, KEEP = 5;  // of so many moments one is kept, from which the others follow
  const STRIDE = 0.5, CLICK = Math.PI / 12, APART = 0.3;  // m and rad for a key; m from one point of a drawn path to the next
  const LONGEST = 3000;  // controls of a path of one's own: five minutes
  const RATE = 100;  // the noise is given for one sample of so many a second, as in the report

  /** Particles that leave the same start and are predicted through all controls, each with its own errors. */
  class Fan {
    constructor(options) {
      this.settings = {particles: 250, sigmaV: 0.316, sigmaOmega: 0.4, seed: 1, path: "lap", part: 30, ...options};
      this.lap = world.controlsTo(START, LAP, DT);
      this.clear();
      this.throwDice();
    }

    get controls() { return this.settings.path === "lap" ? this.lap : this.own; }
    get step() { return Math.round((this.settings.part / 100) * this.controls.v.length); }
    get time() { return this.step * this.controls.dt; }
    get noise() {
      const {sigmaV, sigmaOmega} = this.settings, root = 1 / Math.sqrt(RATE);
      return {sigmaV: root * sigmaV, sigmaOmega: root * sigmaOmega, perRootSecond: true};
    }

    /** An empty path of one's own. */
    clear() {
      this.own = {start: START, dt: DT, v: [], omega: []};
      this.begun = false;
      this.forget();
    }

    /** New random numbers for every particle and moment, drawn as they are needed. */
    throwDice() {
      Object.assign(this, {generator: core.generator(this.settings.seed), dice: []});
      this.forget();
    }

    /** Nothing that has been predicted holds any more; the random numbers stay. */
    forget() { Object.assign(this, {kept: null, reckoned: null}); }

    /** Where one's own path ends, [x, y, theta]. */
    get end() {
      const {own} = this, last = core.integrate(own, own.start);
      return Array.from(last.subarray(-3), (value, k) => (k < 2 ? value : core.wrapAngle(value)));
    }

    /** Drive on from the end of one's own path to a place, round walls: the first place is where it begins. */
    extend(x, y) {
      const {own} = this;
      if (!this.begun) {
        if (!world.room([x, y])) return;
        Object.assign(this, {begun: true});
        own.start = [x, y, 0];
        this.forget();
      } else if (own.v.length < LONGEST && world.room([x, y])) {
        const {v, omega} = world.controlsTo(this.end, [[x, y]], DT);
        own.v.push(...v);
        own.omega.push(...omega);
      }
    }

    /** Turn on the spot by an angle (rad). */
    turn(angle) {
      const steps = Math.ceil(Math.abs(angle) / (TURN * DT) - 1e-9);
      this.begun = true;
      for (let k = 0; k < steps; k++) { this.own.v.push(0); this.own.omega.push(angle / (steps * DT)); }
    }

    /** A stride straight ahead, as far as walls let it. */
    stride() {
      const [x, y, theta] = this.end, steps = Math.round(STRIDE / (0.7 * DT));
      this.begun = true;
      for (let k = 1; k <= steps && this.own.v.length < LONGEST; k++) {
        const ahead = (k / steps) * STRIDE;
        if (!world.room([x + ahead * Math.cos(theta), y + ahead * Math.sin(theta)])) return;
        this.own.v.push(STRIDE / (steps * DT));
        this.own.omega.push(0);
      }
    }

    /** Go to the moment at which the path without noise is nearest to a place; where it crosses itself, the nearest in time. */
    goTo(x, y) {
      const {straight, step} = this, away = k => Math.hypot(straight[k][0] - x, straight[k][1] - y) + 0.005 * Math.abs(k - step);
      let best = 0;
      for (let k = 1; k < straight.length; k++) if (away(k) < away(best)) best = k;
      return (100 * best) / Math.max(1, straight.length - 1);
    }

    /** The particles after so many controls. Eq. 11, one control after the other. */
    poses(step = this.step) {
      const {controls, settings: {particles: n}, noise} = this;
      const start = () => Float64Array.from({length: 3 * n}, (_, k) => controls.start[k % 3]);
      const kept = (this.kept = this.kept || [start()]), known = Math.min(Math.floor(step / KEEP), kept.length - 1);
      let poses = kept[known];
      for (let k = known * KEEP; k < step; k++) {
        const normals = (this.dice[k] = this.dice[k] || this.generator.normals(2 * n));
        poses = core.predict(poses, controls.v[k], controls.omega[k], controls.dt, noise, normals);
        if ((k + 1) % KEEP === 0) kept[(k + 1) / KEEP] = poses;
      }
      return poses;
    }

    /** The path without noise, [x, y, theta] after each control. */
    get straight() {
      const {controls} = this, path = (this.reckoned = this.reckoned || [controls.start]);
      for (let k = path.length - 1; k < controls.v.length; k++) {
        path.push(Array.from(core.motionModel(path[k], controls.v[k], controls.omega[k], controls.dt)));
      }
      return path;
    }

    /** How far the particles are from their middle (m) and their headings from the mean one (rad), root mean square. */
    get spread() {
      const poses = this.poses(), n = poses.length / 3, [x, y, theta] = core.averagePose(poses, new Float64Array(n).fill(1 / n));
      let metres = 0, turns = 0;
      for (let k = 0; k < n; k++) {
        metres += (poses[3 * k] - x) ** 2 + (poses[3 * k + 1] - y) ** 2;
        turns += core.wrapAngle(poses[3 * k + 2] - theta) ** 2;
      }
      return {metres: Math.sqrt(metres / n), heading: Math.sqrt(turns / n)};
    }
  }

  lab("cloud", stage => {
    const fan = new Fan(stage.options), {settings} = fan, shown = {paths: true};
    const plan = stage.plan({
      name: "The particles, and the path without noise, from above",
      help: "Drag the robot along its path, or draw a path of your own; a tap drives on to that place. Keys: up drives on by half a metre, " +
        "left and right turn, Backspace clears your path.",
      window: WINDOW,
    });
    stage.words([dot("particles", "<b>Each blue dot is a particle</b>, a guess of where the robot is by now."),
                 dot("odometry", "dead reckoning, the path without noise.")].join(" "));
    const to = part => {
      driven.value = part;
      driven.dispatchEvent(new Event("input"));
      if (Number(driven.value) >= 100) clock.pause();
    };
    const tick = by => to(Number(driven.value) + by);
    const clock = stage.clock({hertz: 30, tick: () => tick(0.25), step: () => tick(5)});
    stage.slider({name: "Speed noise", min: 0, max: 4, step: 0.01, value: settings.sigmaV, unit: "m/s",
                  change: value => { settings.sigmaV = value; fan.forget(); }});
    stage.slider({name: "Yaw rate noise", min: 0, max: 1.2, step: 0.002, value: settings.sigmaOmega, unit: "rad/s",
                  change: value => { settings.sigmaOmega = value; fan.forget(); }});
    stage.fold("More");
    clock.fold();
    const driven = stage.slider({name: "Driven", min: 0, max: 100, step: 0.25, value: settings.part, unit: "%", digits: 0,
                                 change: value => { settings.part = value; }});
    stage.button({name: "Back to the start", key: "n", press: () => to(0)});
    stage.button({name: "New dice", key: "d", press: () => { settings.seed += 1; fan.throwDice(); }});
    stage.check({name: "Some whole paths", key: "p", value: true, change: value => { shown.paths = value; }});
    stage.slider({name: "Particles", min: 10, max: 1000, step: 10, value: settings.particles, digits: 0,
                  change: value => { settings.particles = value; fan.throwDice(); }});
    const change = path => { settings.path = path; fan.forget(); clock.pause(); };
    const which = stage.choice({name: "Path", options: {lap: "through the building", own: "your own"}, value: "lap", change});

    /** From now on the path is the reader's, shown to its end. */
    function own() {
      if (settings.path !== "own") change("own");
      which.querySelector("[value=own]").checked = true;
      clock.pause();
      to(100);
    }
    /** Drive one's own path from its beginning, so that the cloud is seen to grow. */
    function replay() {
      if (stage.calm) return;
      to(0);
      clock.start();
    }
    let last = null;
    const onRobot = (x, y) => plan.near(x, y, fan.straight[fan.step]);
    stage.drag(plan, {
      grab: onRobot,
      start: (x, y) => { last = {x, y, robot: onRobot(x, y), drawn: false, part: settings.part}; },
      move: (x, y) => {
        if (last.robot) { clock.pause(); to(fan.goTo(x, y)); return; }
        if (Math.hypot(x - last.x, y - last.y) < APART) return;
        if (!last.drawn) { fan.clear(); fan.extend(last.x, last.y); }
        fan.extend(x, y);
        last = {...last, x, y, drawn: true};
        own();
      },
      end: cancelled => {
        if (last.robot) { if (cancelled) to(last.part); return; }
        if (last.drawn) { replay(); return; }
        if (cancelled) return;
        if (!fan.begun) fan.extend(...START.slice(0, 2));
        fan.extend(last.x, last.y);
        own();
      },
    });
    const key = action => down => { if (down) { action(); own(); } };
    stage.keys(plan, {ArrowUp: key(() => fan.stride()), ArrowLeft: key(() => fan.turn(CLICK)), ArrowRight: key(() => fan.turn(-CLICK)),
                      Backspace: key(() => fan.clear())});
    return {state: fan, draw: () => paint(plan, stage.colours, fan, shown), describe: () => sentence(fan)};
  });

  function paint(plan, colours, fan, shown) {
    const {step, straight, spread} = fan, poses = fan.poses(), n = fan.settings.particles, flat = path => path.flatMap(([x, y]) => [x, y]);
    draw.kept(plan, [colours, straight, straight.length], sheet => {
      world.paint(sheet, colours);
      draw.line(sheet, flat(straight), colours.muted, {width: 1});
    });
    if (shown.paths) {
      for (let k = 0; k < Math.min(SHOWN, n); k++) {
        const path = fan.kept.slice(0, Math.floor(step / KEEP) + 1).flatMap(moment => [moment[3 * k], moment[3 * k + 1]]);
        draw.line(plan, [...path, poses[3 * k], poses[3 * k + 1]], colours.particles, {width: 1});
      }
    }
    draw.line(plan, flat(straight.slice(0, step + 1)), colours.odometry, {dash: [7, 4]});
    const apart = Math.max(KEEP, KEEP * Math.round(straight.length / (KEEP * ELLIPSES)));
    for (let k = apart; k < step; k += apart) ellipse(plan, fan.kept[k / KEEP], colours.estimate);
    const places = Float64Array.from({length: 2 * n}, (_, k) => poses[3 * (k >> 1) + (k & 1)]);
    draw.dots(plan, places, colours.particles, plan.width < 500 ? 1.8 : 2.6, {colour: colours.estimate, width: 0.5});
    world.robot(plan, straight[step], colours, "odometry");
    const around = `${spread.metres.toFixed(2)} m and ${(180 / Math.PI * spread.heading).toFixed(0)}° around their middle`;
    plan.write(fan.controls.v.length ? `After ${fan.time.toFixed(0)} s (${fan.settings.part.toFixed(0)} %) the dots are ${around}.`
      : "Draw a path, or drive with the arrow keys.");
  }

  /** The ellipse that holds nine of ten particles, if they are normally distributed: covariance of x and y, chi-square of two. */
  function ellipse(plan, poses, colour) {
    const n = poses.length / 3, mean = [0, 0], cov = [0, 0, 0];
    for (let k = 0; k < n; k++) { mean[0] += poses[3 * k] / n; mean[1] += poses[3 * k + 1] / n; }
    for (let k = 0; k < n; k++) {
      const x = poses[3 * k] - mean[0], y = poses[3 * k + 1] - mean[1];
      cov[0] += (x * x) / n;
      cov[1] += (x * y) / n;
      cov[2] += (y * y) / n;
    }
    const middle = (cov[0] + cov[2]) / 2, half = Math.hypot((cov[0] - cov[2]) / 2, cov[1]), {context} = plan;
    const [long, short] = [middle + half, Math.max(0, middle - half)].map(value => Math.sqrt(4.605 * value) * plan.scale);
    context.beginPath();
    context.ellipse(...plan.at(...mean), long, short, -0.5 * Math.atan2(2 * cov[1], cov[0] - cov[2]), 0, 2 * Math.PI);
    Object.assign(context, {strokeStyle: colour, lineWidth: 1.5});
    context.stroke();
  }

  function sentence(fan) {
    const {settings, spread, time} = fan;
    if (!fan.controls.v.length) return "No path yet. Draw one, or drive with the arrow keys.";
    return `After ${time.toFixed(1)} seconds of ${settings.path === "lap" ? "the drive" : "your path"}, ${settings.particles} particles ` +
      `are ${spread.metres.toFixed(2)} metres away from their middle, root mean square, and their headings differ by ` +
      `${(180 / Math.PI * spread.heading).toFixed(1)} degrees.`;
  }
})(globalThis);
