/* Lost (chapter 10): a robot wakes up in a building that is nearly the same after half a turn. The map is given, the pose is
 * not: particles begin everywhere, two heaps are left, and an open door decides between them. */
(function (root) {
  "use strict";
  const {core, draw, lab, Driver} = root.pfslam;

  const HERTZ = 60, LOOK = 12;  // ticks in a second; ticks from one scan to the next
  const SPEED = 0.9, TURN = 1.8, RADIUS = 0.2, ROOM = 0.28;  // m/s, rad/s, m
  const MIDDLE = [6, 3], WINDOW = [-0.2, 12.2, -0.2, 6.2];
  const SPEC = {origin: [-0.4, -0.4], resolution: 0.1, shape: [68, 128]};
  const LIDAR = {angleMin: -2.4, angleMax: 2.4, beams: 61, rangeMin: 0.1, rangeMax: 4, position: [0, 0]};
  const MODEL = {sigma: 0.2, random: 0.1, beams: 5};  // m; likelihood of an end point that no wall explains; beams a scan is worth
  const NOISE = {xy: 0.02, xyPerMetre: 0.08, yaw: 0.005, yawPerRadian: 0.05, yawPerMetre: 0.06};
  const SLOW = 0.01, FAST = 0.2, EXPECTED = 0.9, LEAST = 500, NEAR = 1;
  const ROUTE = [[2.5, 1.3], [2.5, 3], [8, 3], [8, 1.3], [8, 3], [10.9, 3], [10.9, 1.4], [10.9, 3], [2.5, 3], [2.5, 1.3], [4.2, 0.8]];
  const START = [4.2, 0.8, 2.6], PLACES = [[8, 1.2, 1.5], [1, 3, 0], [9.4, 5, -1.6], [3.6, 4.8, 0]];  // where a kidnapper leaves it
  const HALF = [[0, 0, 12, 0], [12, 0, 12, 3], [0, 0, 0, 3], [0, 2.2, 2, 2.2], [3, 2.2, 7.5, 2.2], [8.5, 2.2, 10.4, 2.2], [5.2, 0, 5.2, 1.2],
                [1, 0.7, 1.7, 0.7], [1.7, 0.7, 1.7, 1.3], [1.7, 1.3, 1, 1.3], [1, 1.3, 1, 0.7], [11, 0, 12, 0.9], [6.4, 0.5, 7, 0.5]];
  const turned = ([x0, y0, x1, y1]) => [2 * MIDDLE[0] - x0, 2 * MIDDLE[1] - y0, 2 * MIDDLE[0] - x1, 2 * MIDDLE[1] - y1];
  // Half a turn makes the same building of it, but for the door at the right end of the lower wall.
  const WALLS = Float64Array.from([...HALF, ...HALF.map(turned), [11.4, 2.2, 12, 2.2], [0, 3.8, 1.6, 3.8]].flat());
  const twin = ([x, y, theta]) => [2 * MIDDLE[0] - x, 2 * MIDDLE[1] - y, core.wrapAngle(theta + Math.PI)];

  const BUILDING = {walls: WALLS, spec: SPEC, route: ROUTE, radius: RADIUS, room: ROOM, speed: SPEED, turn: TURN};

  /** The map of the building: walls, the floor that can be reached, and the rest unknown. */
  const GRID = (() => {
    const [rows, columns] = SPEC.shape, logOdds = new Float32Array(rows * columns);
    for (let w = 0; w < WALLS.length; w += 4) {
      const steps = Math.ceil(Math.hypot(WALLS[w + 2] - WALLS[w], WALLS[w + 3] - WALLS[w + 1]) / 0.02);
      for (let k = 0; k <= steps; k++) {
        const place = [0, 1].map(c => WALLS[w + c] + (k / steps) * (WALLS[w + 2 + c] - WALLS[w + c]));
        const [ix, iy] = core.worldToCell(SPEC, place);
        logOdds[iy * columns + ix] = 1;
      }
    }
    const [ix, iy] = core.worldToCell(SPEC, START.slice(0, 2)), queue = [iy * columns + ix];
    logOdds[queue[0]] = -1;
    for (let next = 0; next < queue.length; next++) {
      for (const there of [1, -1, columns, -columns].map(step => queue[next] + step)) {
        if (logOdds[there] === 0) { logOdds[there] = -1; queue.push(there); }
      }
    }
    return {spec: SPEC, logOdds};
  })();
  const FREE = Uint8Array.from(GRID.logOdds, value => value < 0), FIELD = core.likelihoodField(core.occupied(GRID), SPEC, MODEL);
  const FLOOR = [...FREE.keys()].filter(k => FREE[k]);

  /** The robot in its building, and the cloud that looks for it. */
  class Search extends Driver {
    constructor(options) {
      super();
      this.settings = {first: 20000, inject: true, adaptive: true, seed: 1, ...options};
      this.reset();
    }

    reset() {
      const {seed, first} = this.settings;
      Object.assign(this, {
        worldDice: core.generator(seed), dice: core.generator(seed + 1), ticks: 0, looks: 0, kidnaps: 0,
        motion: [0, 0, 0], slow: EXPECTED, fast: null, injected: 0, history: [],
        points_b: new Float64Array(0), trace: [],
      });
      this.park(BUILDING, START);
      this.poses = this.everywhere(first);
      this.logWeights = new Float64Array(first).fill(-Math.log(first));
      this.look();
    }

    get weights() { return this.logWeights.map(Math.exp); }

    /** So many poses, evenly over the free cells and all headings. */
    everywhere(n) {
      const poses = new Float64Array(3 * n), {dice} = this, side = SPEC.resolution;
      for (let k = 0; k < n; k++) {
        const cell = FLOOR[Math.floor(dice.uniform() * FLOOR.length)];
        poses[3 * k] = SPEC.origin[0] + side * (cell % SPEC.shape[1] + dice.uniform());
        poses[3 * k + 1] = SPEC.origin[1] + side * (Math.floor(cell / SPEC.shape[1]) + dice.uniform());
        poses[3 * k + 2] = Math.PI * (2 * dice.uniform() - 1);
      }
      return poses;
    }

    /** One sixtieth of a second of driving. */
    tick() {
      this.ticks += 1;
      const dt = 1 / HERTZ, [v, omega] = this.command();
      const bumped = this.moveTo(Array.from(core.motionModel(this.truth, v, omega, dt)));
      const noise = this.worldDice.normals(2), moved = bumped ? 0 : v * dt * (1 + 0.05 * noise[0]);
      this.motion = core.compose(this.motion, [moved, 0, omega * dt + 0.003 * noise[1] * Math.abs(v) * dt * HERTZ]);
      if (this.ticks % LOOK === 0 && (Math.hypot(...this.motion.slice(0, 2)) > 0.1 || Math.abs(this.motion[2]) > 0.1)) this.look();
    }

    /** Predict by the motion since the last scan, weigh by the scan, and draw the cloud anew where it needs it. */
    look() {
      const {motion, dice, settings} = this, n = this.logWeights.length;
      if (this.looks) {
        const metres = Math.hypot(motion[0], motion[1]), normals = dice.normals(3 * n);
        const xy = NOISE.xy + NOISE.xyPerMetre * metres, yaw = NOISE.yaw + NOISE.yawPerRadian * Math.abs(motion[2]) + NOISE.yawPerMetre * metres;
        const before = this.poses;
        this.poses = new Float64Array(3 * n);
        for (let k = 0; k < n; k++) {
          const own = [motion[0] + xy * normals[3 * k], motion[1] + xy * normals[3 * k + 1], motion[2] + yaw * normals[3 * k + 2]];
          this.poses.set(core.compose(before.subarray(3 * k, 3 * k + 3), own), 3 * k);
        }
        this.note({motion, normals, before});
      }
      const noise = this.worldDice.normals(LIDAR.beams);
      const ranges = core.castRays(WALLS, [], this.truth, core.beamAngles(LIDAR)).map((range, k) => range + 0.02 * noise[k]);
      Object.assign(this, {points_b: core.scanPoints(ranges, LIDAR), motion: [0, 0, 0], looks: this.looks + 1});
      if (!this.points_b.length) return;
      const {logWeights, logEvidence} = core.reweight(this.logWeights, core.lostLogLikelihood(FIELD, SPEC, FREE, this.points_b, this.poses, MODEL));
      this.logWeights = logWeights;
      const fit = Math.exp(logEvidence / MODEL.beams);
      this.slow += SLOW * (fit - this.slow);
      this.fast = this.fast === null ? fit : this.fast + FAST * (fit - this.fast);
      this.injected = settings.inject ? Math.max(0, 1 - this.fast / this.slow) : 0;
      this.history.push(this.shares);
      this.note({points: this.points_b, poses: this.poses, logWeights});
      if (this.injected || core.effectiveSampleSize(this.weights) <= 0.5 * logWeights.length) this.resample();
    }

    /** Draw the cloud anew: as many as its bins ask for, and a share of them from the whole map. */
    resample() {
      const {dice, settings, weights, injected} = this, most = settings.first;
      const drawn = n => {
        const fresh = Math.round(injected * n), kept = core.chosen(this.poses, core.systematicResample(weights, dice.uniform(), n - fresh));
        const poses = new Float64Array(3 * n);
        poses.set(kept);
        poses.set(this.everywhere(fresh), kept.length);
        return poses;
      };
      let number = most;
      if (settings.adaptive) {
        const trial = drawn(most);
        for (let k = most - 1; k > 0; k--) {  // in any order: a heap after the other would be counted too soon
          const other = Math.floor(dice.uniform() * (k + 1)), row = trial.slice(3 * k, 3 * k + 3);
          trial.copyWithin(3 * k, 3 * other, 3 * other + 3);
          trial.set(row, 3 * other);
        }
        number = core.enough(trial, Math.min(LEAST, most));
      }
      this.poses = drawn(number);
      this.logWeights = new Float64Array(number).fill(-Math.log(number));
    }

    /** The shares of the weight within a metre of the robot, and of its twin half a turn round. */
    get shares() {
      const {weights, poses, truth} = this;
      return [truth, twin(truth)].map(([x, y, theta]) => weights.reduce((sum, weight, k) => {
        const near = Math.hypot(poses[3 * k] - x, poses[3 * k + 1] - y) < NEAR && Math.abs(core.wrapAngle(poses[3 * k + 2] - theta)) < 0.5;
        return sum + (near ? weight : 0);
      }, 0));
    }

    kidnap() {
      this.truth = PLACES[this.kidnaps % PLACES.length].slice();
      Object.assign(this, {way: [], target: null, kidnaps: this.kidnaps + 1, leg: this.kidnaps % 2 ? 4 : 1});
    }

    note(event) { if (this.settings.trace) this.trace.push(event); }
  }

  lab("lost", stage => {
    const search = new Search(stage.options), {settings} = search;
    const plan = stage.plan({
      name: "The building with the particles, the robot, and its twin half a turn round",
      help: "Drive: tap a place, or use the arrow keys. Find a place that tells the robot from its twin.",
      window: WINDOW,
    });
    stage.words([["particles", "<b>Each dot is a guess</b>."], ["truth", "the robot, which the filter cannot see."],
                 ["odometry", "its twin, half a turn round."]].map(([colour, words]) =>
      `<span class="pfslam-dot" aria-hidden="true" style="color:var(--lab-${colour})">●</span>\u00a0${words}`).join(" "));
    const strip = stage.chart({name: "The share of the weight at the robot, and at its twin, over the last scans", height: 80});
    const clock = stage.clock({hertz: HERTZ, tick: () => search.tick(), step: () => { for (let k = 0; k < HERTZ / 2; k++) search.tick(); }});
    stage.button({name: "Kidnap", key: "k", press: () => { search.kidnap(); clock.wake(); }});
    stage.check({name: "Inject where the scan does not fit", key: "i", value: true, change: value => { settings.inject = value; }});
    stage.check({name: "Number by KLD", key: "l", value: true, change: value => { settings.adaptive = value; }});
    stage.slider({name: "Particles at first", min: 100, max: 20000, step: 100, value: settings.first, digits: 0,
                  change: value => { settings.first = value; search.reset(); auto.checked = true; }});
    stage.fold("More settings");
    stage.button({name: "Start again", key: "n", press: () => { search.reset(); auto.checked = true; }});
    stage.button({name: "New dice", key: "d", press: () => { settings.seed += 1; search.reset(); auto.checked = true; }});
    const auto = stage.driven(plan, search, clock);
    return {
      state: search,
      constants: {SPEC, LIDAR, MODEL, NOISE, LEAST, logOdds: GRID.logOdds},
      draw() { paint(plan, stage.colours, search); paintShares(strip, stage.colours, search); },
      describe: () => sentence(search),
    };
  });

  function paint(plan, colours, search) {
    const {poses, truth, points_b, logWeights} = search, n = logWeights.length, size = plan.width < 500 ? 12 : 16;
    plan.clear(colours.paper);
    draw.grid(plan, GRID, colours, 1);
    draw.rays(plan, truth.slice(0, 2), core.transformPoints(truth, points_b), colours.clear);
    const places = Float64Array.from({length: 2 * n}, (_, k) => poses[3 * (k >> 1) + (k & 1)]);
    draw.dots(plan, places, n > 3000 ? colours.estimate : colours.particles, n > 3000 ? 0.9 : 2.2);
    if (n <= 3000) { Object.assign(plan.context, {strokeStyle: colours.estimate, lineWidth: 0.75}); plan.context.stroke(); }
    draw.robot(plan, twin(truth), colours.odometry, {radius: RADIUS});
    draw.robot(plan, truth, colours.truth, {radius: RADIUS, fill: colours.muted});
    if (search.target) draw.dots(plan, search.target, colours.highlight, 6);
    draw.text(plan, news(search), 8, 1.3 * size, colours.ink, {size, halo: colours.paper});
  }

  /** What happens, in a line. */
  function news(search) {
    const {refused, injected, logWeights} = search, [here, there] = search.shares, n = logWeights.length.toLocaleString("en");
    if (refused) return refused;
    if (injected > 0.02) return `The scan fits badly: ${(100 * injected).toFixed(0)} % of ${n} guesses are new, from everywhere.`;
    if (here + there < 0.8) return `${n} guesses, all over the building.`;
    if (Math.min(here, there) > 0.05) return `${n} guesses in two heaps: ${(100 * here).toFixed(0)} % at the robot, ${(100 * there).toFixed(0)} % at its twin.`;
    return here > there ? `Found: ${n} guesses, ${(100 * here).toFixed(0)} % at the robot.` : `Sure, and wrong: ${(100 * there).toFixed(0)} % at the twin.`;
  }

  /** The two shares over the last scans. */
  function paintShares(strip, colours, search) {
    strip.clear(colours.paper);
    for (const [k, colour] of [[0, colours.truth], [1, colours.odometry]]) {
      draw.strip(strip, search.history.map(shares => shares[k]), {room: 150, top: 1, level: 0.5, colour, levelColour: colours.muted});
    }
    draw.text(strip, "share of the weight: at the robot, at its twin", 8, 18, colours.ink, {size: strip.width < 500 ? 12 : 14, halo: colours.paper});
  }

  function sentence(search) {
    const [here, there] = search.shares.map(share => (100 * share).toFixed(0));
    return `${search.logWeights.length} particles; ${here} percent of the weight lie at the robot and ${there} percent at its twin half a turn round.`;
  }
})(globalThis);
