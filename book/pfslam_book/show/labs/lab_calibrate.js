/* Calibrate (chapter 01): wheels and gyro of a real drive, read with numbers that the reader turns. */
(function (root) {
  "use strict";
  const {core, draw, lab} = root.pfslam;

  const FIT = 0.3;  // m (rms): so near to the truth the path fits
  const WINDOW = [-9, 31, -4.5, 25.5], RADIUS = 0.6;  // m
  const BLANK = {bias: 0, gyro: 1, wheels: 1};  // rad/s and two factors: what a robot believes that was never calibrated
  const ENDS = {bias: [-0.006, 0.006], gyro: [0.85, 1.15], wheels: [0.85, 1.15], track: [0.3, 1.2]};  // of the sliders
  const TURNING = 0.15;  // rad/s: from here on the robot turns
  const DEGREES = 180 / Math.PI;

  /** What the sensors of a drive said, and how the reader reads it. */
  class Calibration {
    constructor({hertz, units, right, track, steps, seed = 10}) {
      const metres = name => Float64Array.from(steps[name], value => units[name] * value);
      Object.assign(this, {dt: 1 / hertz, right, tape: track, robot: "hidden", by: "gyro", dice: core.generator(seed)});
      this.recorded = {left: metres("left"), right: metres("right"), turned: metres("turned")};
      const n = steps.x.length, [x, y, theta] = ["x", "y", "theta"].map(metres);
      this.truth = new Float64Array(3 * (n + 1));
      for (let k = 0; k < n; k++) {
        [x, y, theta].forEach((step, part) => { this.truth[3 * k + 3 + part] = this.truth[3 * k + part] + step[k]; });
      }
      Object.assign(this, {n, moment: n});
      this.turns = Array.from(theta, step => Math.abs(step) > TURNING * this.dt);
      this.draw();
    }

    /** Another robot, with faults of its own. */
    draw() {
      const off = (least, most) => (this.dice.uniform() < 0.5 ? -1 : 1) * (least + (most - least) * this.dice.uniform());
      this.faults = {bias: off(0.0015, 0.0045), gyro: 1 + off(0.03, 0.1), wheels: 1 + off(0.03, 0.1), track: 0.75 + off(0.05, 0.3)};
      this.reset();
    }

    /** The numbers as if nobody had ever calibrated; the track as the tape measures it. */
    reset() {
      this.guess = {...BLANK, track: this.tape};
      this.follow();
    }

    /** The numbers that bring the path onto the truth. */
    get answer() { return this.robot === "hidden" ? this.faults : this.right; }

    /** What the sensors of this robot say: those of the drive, or what faulty ones would have said on it. */
    get readings() {
      const {recorded, right, answer, dt} = this, size = right.wheels / answer.wheels;
      const wider = size * ((answer.track / right.track - 1) / 2);  // each side is that much of their difference off
      const difference = recorded.right.map((value, k) => value - recorded.left[k]);
      const turned = core.yawRate(recorded.turned.map(value => value / dt), {gyroBias: right.bias, gyroScale: right.gyro});
      return {
        left: recorded.left.map((value, k) => size * value - wider * difference[k]),
        right: recorded.right.map((value, k) => size * value + wider * difference[k]),
        rates: turned.map(rate => rate / answer.gyro + answer.bias),
      };
    }

    /** Integrate the readings with the reader's numbers. Eq. 5. */
    follow() {
      const {guess, dt, readings} = this, [left, right] = [readings.left, readings.right].map(side => side.map(s => guess.wheels * s));
      const v = left.map((distance, k) => (distance + right[k]) / 2 / dt);
      const omega = this.by === "gyro"
        ? core.yawRate(readings.rates, {gyroBias: guess.bias, gyroScale: guess.gyro})
        : core.wheelTurns(left, right, guess.track).map(angle => angle / dt);
      this.poses = core.integrate({v, omega, dt}, [0, 0, 0]);
      this.error = core.trajectoryError(this.poses, this.truth);
    }

    set(name, value) {
      this.guess[name] = value;
      this.follow();
    }

    /** Pull the path to a place at the chosen moment, as well as the two numbers that turn it can: Gauss-Newton. */
    pull(x, y) {
      const names = this.by === "gyro" ? ["bias", "gyro"] : ["track", "wheels"], k = this.moment;
      const miss = () => [x - this.at(this.poses, k)[0], y - this.at(this.poses, k)[1]], far = ([dx, dy]) => Math.hypot(dx, dy);
      for (let round = 0; round < 4; round++) {
        const start = {...this.guess}, before = miss();
        const slopes = names.map(name => {
          const small = 1e-3 * (ENDS[name][1] - ENDS[name][0]);
          this.set(name, start[name] + small);
          const after = miss();
          this.set(name, start[name]);
          return before.map((value, part) => (value - after[part]) / 1e-3);  // of a number counted in lengths of its slider
        });
        const [[a, c], [b, d]] = slopes, dot = (p, q) => p[0] * q[0] + p[1] * q[1], damp = 1e-3 * (a * a + b * b + c * c + d * d);
        const [aa, ab, bb] = [dot(slopes[0], slopes[0]) + damp, dot(...slopes), dot(slopes[1], slopes[1]) + damp];
        const [ga, gb] = slopes.map(slope => dot(slope, before)), determinant = aa * bb - ab * ab;
        const step = [(bb * ga - ab * gb) / determinant, (aa * gb - ab * ga) / determinant];
        names.forEach((name, part) => {
          const [least, most] = ENDS[name];
          this.guess[name] = Math.max(least, Math.min(most, start[name] + step[part] * (most - least)));
        });
        this.follow();
        if (far(miss()) > far(before)) { this.guess = start; this.follow(); return; }
      }
    }

    at(poses, k = this.moment) { return poses.subarray(3 * k, 3 * k + 3); }

    /** Distance (m) between path and truth at the chosen moment. */
    get apart() {
      const [here, there] = [this.at(this.poses), this.at(this.truth)];
      return Math.hypot(here[0] - there[0], here[1] - there[1]);
    }

    /** Errors of the heading (degrees), one for each moment. */
    get headings() {
      return Float64Array.from({length: this.n + 1}, (_, k) => DEGREES * (this.poses[3 * k + 2] - this.truth[3 * k + 2]));
    }

    get fits() { return this.error.ateRmse < FIT; }

    go(k) { this.moment = Math.max(0, Math.min(this.n, Math.round(k))); }

    /** Go to the moment at which the robot truly was nearest to a place. Ways that cross there: the one nearest in time. */
    goTo(x, y) {
      const away = k => Math.hypot(this.truth[3 * k] - x, this.truth[3 * k + 1] - y) + 0.02 * this.dt * Math.abs(k - this.moment);
      let best = 0;
      for (let k = 1; k <= this.n; k++) if (away(k) < away(best)) best = k;
      this.go(best);
    }
  }

  lab("calibrate", stage => {
    const state = new Calibration(stage.options), shown = {answer: false, held: null, moved: false};
    const plan = stage.plan({
      name: "The true path and the path that wheels and gyro give with these numbers",
      help: "Drag the robot on the coloured path, and the gyro's numbers follow. Drag along the path, or press left and right, to " +
        "see both robots at another moment.",
      window: WINDOW,
    });
    const chart = stage.chart({name: "The error of the heading over time, with the turns shaded", height: 120});
    stage.words(
      '<span class="pfslam-dot" aria-hidden="true" style="color:var(--lab-truth)">●</span>\u00a0the true path. ' +
      '<span class="pfslam-dot" aria-hidden="true" style="color:var(--lab-odometry)">●</span>\u00a0what wheels and gyro give with your numbers; it turns ' +
      `<span class="pfslam-dot" aria-hidden="true" style="color:var(--lab-clear)">●</span>\u00a0green below ${FIT} m.`);
    const sliders = {};
    const slider = (key, options) => {
      const [min, max] = ENDS[key];
      sliders[key] = stage.slider({...options, min, max, value: state.guess[key], change: value => state.set(key, value)});
    };
    slider("bias", {name: "Gyro bias", step: 0.00002, unit: "rad/s", digits: 5});
    slider("gyro", {name: "Gyro scale", step: 0.0005, digits: 4});
    slider("wheels", {name: "Wheel scale", step: 0.0005, digits: 4});
    slider("track", {name: "Track width", step: 0.001, unit: "m", digits: 3});
    /** Only the numbers that matter can be turned; all stand where the state has them. */
    const show = () => {
      for (const [key, input] of Object.entries(sliders)) {
        const used = key === "wheels" || (key === "track") === (state.by === "wheels");
        input.parentElement.style.display = used ? "" : "none";
        input.value = state.guess[key];
        input.dispatchEvent(new Event("input"));
      }
    };
    stage.button({name: "Start again", key: "n", press: () => { state.reset(); show(); }});
    stage.button({name: "Another robot", key: "r", press: () => {
      stage.body.querySelector("input[value=hidden]").checked = true;
      state.robot = "hidden";
      state.draw();
      show();
    }});
    stage.check({name: "Tell the numbers", key: "t", change: value => { shown.answer = value; }});
    stage.fold("More settings");
    stage.choice({name: "Turns from", options: {gyro: "the gyro", wheels: "the wheels alone"}, value: state.by,
                  change: by => { state.by = by; show(); }});
    stage.choice({name: "Robot", options: {hidden: "one with hidden faults", recorded: "the one of the drive hall"}, value: state.robot,
                  change: robot => { state.robot = robot; state.reset(); show(); }});
    const onPath = (x, y) => plan.near(x, y, state.at(state.poses));
    stage.drag(plan, {
      start: (x, y) => {
        Object.assign(shown, {held: onPath(x, y) && {...state.guess}, moved: false, place: [x, y]});
        if (!shown.held) state.goTo(x, y);
      },
      move: (x, y) => {
        shown.moved = true;
        if (!shown.held) { state.goTo(x, y); return; }
        state.pull(x, y);
        show();
      },
      end: cancelled => {
        if (shown.held && !shown.moved) state.goTo(...shown.place);
        if (shown.held && cancelled) { state.guess = shown.held; show(); }
        shown.held = null;
      },
      grab: onPath,
    });
    const by = seconds => down => { if (down) state.go(state.moment + seconds / state.dt); };
    stage.keys(plan, {ArrowLeft: by(-1), ArrowRight: by(1), Home: by(-1e4), End: by(1e4)});
    show();
    return {
      state,
      draw() { paintPaths(plan, stage.colours, state, shown); paintHeadings(chart, stage.colours, state); },
      describe: () => sentence(state, shown),
    };
  });

  /** The window about the building, as much larger as the path needs. */
  function windowFor(poses) {
    const [left, right, low, high] = WINDOW, [x, y, w, h] = [(left + right) / 2, (low + high) / 2, (right - left) / 2, (high - low) / 2];
    let zoom = 1;
    for (let at = 0; at < poses.length; at += 3) zoom = Math.max(zoom, 1.04 * Math.abs(poses[at] - x) / w, 1.04 * Math.abs(poses[at + 1] - y) / h);
    return [x - zoom * w, x + zoom * w, y - zoom * h, y + zoom * h];
  }

  const places = poses => Float64Array.from({length: (2 * poses.length) / 3}, (_, k) => poses[3 * (k >> 1) + (k % 2)]);

  function paintPaths(plan, colours, state, shown) {
    const {truth, poses, error, n, fits} = state, size = plan.width < 500 ? 13 : 16;
    const [here, there] = [state.at(poses), state.at(truth)], colour = fits ? colours.clear : colours.odometry;
    if (!shown.held) plan.window = windowFor(poses);  // it stands still under the hand
    plan.clear(colours.free);
    draw.line(plan, places(truth), colours.truth, {width: 2, dash: [6, 4]});
    draw.line(plan, places(poses), colour, {width: 3});
    draw.line(plan, [there[0], there[1], here[0], here[1]], colours.hits, {width: 2});
    draw.robot(plan, there, colours.truth, {radius: RADIUS});
    draw.robot(plan, here, colour, {radius: RADIUS, fill: shown.held ? colour : colours.free});
    const when = state.moment === n ? "at the end" : `after ${(state.moment * state.dt).toFixed(0)} s`, halo = colours.free;
    const words = [`${error.ateRmse.toFixed(2)} m from the truth (rms)${fits ? ": it fits" : ""}`, `${state.apart.toFixed(2)} m ${when}`];
    words.forEach((line, k) => draw.text(plan, line, 8, (1.4 * k + 1.4) * size, colours.ink, {size, halo}));
    if (shown.answer) {
      numbers(state, state.answer).forEach((line, k) => {
        draw.text(plan, line, plan.width - 8, (1.3 * k + 1.4) * size, colours.ink, {size: size - 1, align: "right", halo});
      });
    }
  }

  /** The numbers that matter, in words. */
  function numbers(state, {bias, gyro, wheels, track}) {
    const turns = state.by === "gyro" ? [`gyro bias ${bias.toFixed(4)} rad/s`, `gyro scale ${gyro.toFixed(3)}`] : [`track ${track.toFixed(3)} m`];
    return [...turns, `wheel scale ${wheels.toFixed(3)}`];
  }

  /** The error of the heading as a curve about zero, the turns of the drive as shaded bands. */
  function paintHeadings(chart, colours, state) {
    const {context, width, height} = chart, {n, headings, moment} = state, size = width < 500 ? 12 : 14;
    const most = Math.max(...headings.map(Math.abs)), top = [5, 10, 15, 20, 30, 40, 60, 90, 150, 200, 300, 400, 500].find(level => level >= most) || 1000;
    const x = k => (k / n) * width, y = degrees => (0.5 - 0.46 * degrees / top) * height;
    chart.clear(colours.sheet);
    context.fillStyle = colours.paper;
    state.turns.forEach((turning, k) => { if (turning) context.fillRect(x(k), 0, width / n + 0.5, height); });
    const line = (points, colour, wide) => {
      Object.assign(context, {strokeStyle: colour, lineWidth: wide});
      context.beginPath();
      points.forEach(point => context.lineTo(...point));
      context.stroke();
    };
    line([[0, y(0)], [width, y(0)]], colours.muted, 1);
    line([[x(moment), 0], [x(moment), height]], colours.hits, 1.5);
    line(Array.from(headings, (degrees, k) => [x(k), y(degrees)]), state.fits ? colours.clear : colours.odometry, 2.5);
    const write = (words, at, align) => draw.text(chart, words, align === "right" ? width - 6 : 6, at, colours.ink, {size, align, halo: colours.free});
    write(`heading error, at most ${most.toFixed(1)}°`, size + 2, "left");
    write("turns are shaded", height - 6, "left");
    write(`+${top}°`, size + 2, "right");
    write(`−${top}°`, height - 6, "right");
  }

  function sentence(state, shown) {
    const {error, fits, guess, by} = state, off = state.headings[state.moment];
    const when = state.moment === state.n ? "At the end" : `After ${(state.moment * state.dt).toFixed(0)} seconds`;
    const told = shown.answer ? ` The right numbers: ${numbers(state, state.answer).join(", ")}.` : "";
    return `Turns from the ${by}: ${numbers(state, guess).join(", ")}. The path is ${error.ateRmse.toFixed(2)} metres (rms) from the truth` +
      `${fits ? ": it fits" : ""}. ${when} it is ${state.apart.toFixed(2)} metres away and its heading is off by ${off.toFixed(1)} degrees.${told}`;
  }
})(globalThis);
