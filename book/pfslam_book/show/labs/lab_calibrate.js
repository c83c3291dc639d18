/* Calibrate (chapter 01): wheels and gyro of a real drive, read with numbers that the reader turns. */
(function (root) {
  "use strict";
  const {core, draw, lab, world} = root.pfslam, {START, LAP, dot} = world;

  const DT = 0.05, FIT = 0.1;  // s; m (rms): so near to the truth the path fits
  const BLANK = {bias: 0, gyro: 1, wheels: 1};  // rad/s and two factors: what a robot believes that was never calibrated
  const ENDS = {bias: [-0.012, 0.012], gyro: [0.85, 1.15], wheels: [0.85, 1.15], track: [0.3, 1.2]};  // of the sliders
  const TAPE = 0.394, NOISE = {wheels: 0.01, gyro: 0.006};  // the track as a tape measures it, m; of each reading: m/s, rad/s
  const TURNING = 0.15;  // rad/s: from here on the robot turns
  const DEGREES = 180 / Math.PI;

  /** What the sensors of a robot said on its drive, and how the reader reads it. */
  class Calibration {
    constructor({seed = 10}) {
      const {v, omega} = world.controlsTo(START, LAP, DT), n = v.length, dice = core.generator(seed), noise = [0, 1].map(() => dice.normals(n));
      Object.assign(this, {dt: DT, n, moment: n, by: "gyro", tape: TAPE, dice, v, omega, truth: core.integrate({v, omega, dt: DT}, START)});
      this.noise = {v: noise[0].map(value => NOISE.wheels * value), omega: noise[1].map(value => NOISE.gyro * value)};
      this.turns = omega.map(rate => Math.abs(rate) > TURNING);
      this.draw();
    }

    /** Another robot, with faults of its own. */
    draw() {
      const off = (least, most) => (this.dice.uniform() < 0.5 ? -1 : 1) * (least + (most - least) * this.dice.uniform());
      this.answer = {bias: off(0.003, 0.009), gyro: 1 + off(0.03, 0.1), wheels: 1 + off(0.03, 0.1), track: 0.75 + off(0.05, 0.3)};
      this.reset();
    }

    /** The numbers as if nobody had ever calibrated; the track as the tape measures it. */
    reset() {
      this.guess = {...BLANK, track: this.tape};
      this.follow();
    }

    /** What the sensors of this robot say: what each side ran (m), and the yaw rate of the gyro (rad/s). Sides slip as the
     * robot turns, as if they were `answer.track` apart. */
    get readings() {
      const {v, omega, noise, answer, dt} = this;
      const side = sign => Float64Array.from(v, (speed, k) => (dt * (speed + noise.v[k] + (sign * answer.track * omega[k]) / 2)) / answer.wheels);
      return {left: side(-1), right: side(1), rates: Float64Array.from(omega, (rate, k) => (rate + noise.omega[k]) / answer.gyro + answer.bias)};
    }

    /** Integrate the readings with the reader's numbers. Eq. 5. */
    follow() {
      const {guess, dt, readings} = this, [left, right] = [readings.left, readings.right].map(side => side.map(s => guess.wheels * s));
      const v = left.map((distance, k) => (distance + right[k]) / 2 / dt);
      const omega = this.by === "gyro"
        ? core.yawRate(readings.rates, {gyroBias: guess.bias, gyroScale: guess.gyro})
        : core.wheelTurns(left, right, guess.track).map(angle => angle / dt);
      this.poses = core.integrate({v, omega, dt}, START);
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
      window: world.WINDOW,
    });
    const chart = stage.chart({name: "The error of the heading over time, with the turns shaded", height: 84});
    stage.words([dot("truth", "the true path."), dot("odometry", "what wheels and gyro give with your numbers;"),
                 dot("clear", `green: it fits (below ${FIT} m).`)].join(" "));
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
    stage.fold("More");
    stage.button({name: "Start again", key: "n", press: () => { state.reset(); show(); }});
    stage.button({name: "Another robot", key: "r", press: () => { state.draw(); show(); }});
    stage.check({name: "Tell the numbers", key: "t", change: value => { shown.answer = value; }});
    stage.choice({name: "Turns from", options: {gyro: "the gyro", wheels: "the wheels alone"}, value: state.by,
                  change: by => { state.by = by; show(); }});
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
    const [left, right, low, high] = world.WINDOW, [x, y, w, h] = [(left + right) / 2, (low + high) / 2, (right - left) / 2, (high - low) / 2];
    let zoom = 1;
    for (let at = 0; at < poses.length; at += 3) zoom = Math.max(zoom, 1.04 * Math.abs(poses[at] - x) / w, 1.04 * Math.abs(poses[at + 1] - y) / h);
    return [x - zoom * w, x + zoom * w, y - zoom * h, y + zoom * h];
  }

  const places = poses => Float64Array.from({length: (2 * poses.length) / 3}, (_, k) => poses[3 * (k >> 1) + (k % 2)]);

  function paintPaths(plan, colours, state, shown) {
    const {truth, poses, error, n, fits} = state, [here, there] = [state.at(poses), state.at(truth)], name = fits ? "clear" : "odometry";
    if (!shown.held) plan.window = windowFor(poses);  // it stands still under the hand
    world.paint(plan, colours);
    draw.line(plan, places(truth), colours.truth, {width: 2, dash: [6, 4]});
    draw.line(plan, places(poses), colours[name], {width: 3});
    draw.line(plan, [there[0], there[1], here[0], here[1]], colours.hits, {width: 2});
    world.robot(plan, there, colours, "truth");
    world.robot(plan, here, colours, name);
    const when = state.moment === n ? "at the end" : `after ${(state.moment * state.dt).toFixed(0)} s`;
    const told = shown.answer ? ` The right numbers: ${numbers(state, state.answer).join(", ")}.` : "";
    plan.write(`${error.ateRmse.toFixed(2)} m from the truth (rms)${fits ? ": it fits" : ""}, ${state.apart.toFixed(2)} m ${when}.${told}`);
  }

  /** The numbers that matter, in words. */
  function numbers(state, {bias, gyro, wheels, track}) {
    const turns = state.by === "gyro" ? [`gyro bias ${bias.toFixed(4)} rad/s`, `gyro scale ${gyro.toFixed(3)}`] : [`track ${track.toFixed(3)} m`];
    return [...turns, `wheel scale ${wheels.toFixed(3)}`];
  }

  /** The error of the heading as a curve about zero, the turns of the drive as shaded bands. */
  function paintHeadings(chart, colours, state) {
    const {context, width, height} = chart, {n, headings, moment} = state;
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
    const write = (words, at) => draw.text(chart, words, width - 6, at, colours.ink, {size: 12, align: "right", halo: colours.free});
    write(`+${top}°`, 14);
    write(`−${top}°`, height - 6);
    chart.write(`Error of the heading over time, at most ${most.toFixed(1)}°; turns are shaded.`);
  }

  function sentence(state, shown) {
    const {error, fits, guess, by} = state, off = state.headings[state.moment];
    const when = state.moment === state.n ? "At the end" : `After ${(state.moment * state.dt).toFixed(0)} seconds`;
    const told = shown.answer ? ` The right numbers: ${numbers(state, state.answer).join(", ")}.` : "";
    return `Turns from the ${by}: ${numbers(state, guess).join(", ")}. The path is ${error.ateRmse.toFixed(2)} metres (rms) from the truth` +
      `${fits ? ": it fits" : ""}. ${when} it is ${state.apart.toFixed(2)} metres away and its heading is off by ${off.toFixed(1)} degrees.${told}`;
  }
})(globalThis);
