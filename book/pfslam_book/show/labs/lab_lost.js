/* Lost (chapter 10): a robot wakes up in a building that is nearly the same after half a turn. The map is given, the pose is
 * not: particles begin everywhere, two heaps are left, and an open door decides between them. */
(function (root) {
  "use strict";
  const {core, draw, lab, turn, world} = root.pfslam, {WINDOW, SPEC, LIDAR, RADIUS, BUILT, CUPBOARD, twin, dot} = world;

  const HERTZ = 60, LOOK = 12, EVERY = 5;  // ticks in a second; ticks from one scan to the next; of so many beams one is scored
  const MODEL = {sigma: 0.2, random: 0.1, beams: 5};  // m; likelihood of an end point that no wall explains; beams a scan is worth
  const NOISE = {xy: 0.02, xyPerMetre: 0.08, yaw: 0.005, yawPerRadian: 0.05, yawPerMetre: 0.06};
  const SLOW = 0.01, FAST = 0.2, EXPECTED = 0.9, LEAST = 500, NEAR = 1, VALUES = 150;
  const PART = 4000;  // particles that are weighed in one tick: a look of all at once would hold the page up
  const ROUTE = [[7.6, 1.6], [6.4, 0.9], [6.9, 1.3], [6.9, 3], [8, 3.3], [1, 3], [1.7, 3], [1.7, 1.3], [1.7, 3], [6.9, 3], [6.9, 1.3]];
  const START = [6.4, 0.9, 2.6], PLACES = [[7, 1.2, 1.5], [1, 3, 0], [7.4, 5, -1.6], [3.6, 4.8, 0]];  // where a kidnapper leaves it
  const HEART = [8.825, 2.5875], ACROSS = twin([...HEART, 0]).map((there, k) => there - HEART[k]);  // of the cupboard; from there to the twin's place
  const {free: FREE, grid: GRID, occupied} = world.known(), FIELD = core.likelihoodField(occupied, SPEC, MODEL);
  const FLOOR = [...FREE.keys()].filter(k => FREE[k]);

  /** The robot in its building, and the cloud that looks for it. */
  class Search extends world.Driver {
    constructor(options) {
      super();
      this.settings = {first: 20000, inject: true, adaptive: true, pushed: 0, seed: 1, ...options};
      this.reset();
    }

    /** A place of the cupboard, which may be pushed, in per cent of the way to the other end of the corridor: the map does not know it. */
    pushedTo(place) { return place.map((at, k) => at + (this.settings.pushed / 100) * ACROSS[k]); }
    get heart() { return this.pushedTo(HEART); }
    get cupboard() { return CUPBOARD.map(corner => this.pushedTo(corner)); }

    get walls() {
      const {pushed} = this.settings;
      if (this.stands !== pushed) Object.assign(this, {stands: pushed, built: world.wallsOf([...BUILT, this.cupboard])});
      return this.built;
    }

    /** Push the cupboard, unless the robot is in its way. */
    push(part) {
      const {pushed} = this.settings;
      this.settings.pushed = part;
      if (core.touches(world.wallsOf([this.cupboard]), this.truth, RADIUS)) this.settings.pushed = pushed;
    }

    reset() {
      const {seed, first} = this.settings;
      Object.assign(this, {
        worldDice: core.generator(seed), dice: core.generator(seed + 1), ticks: 0, looks: 0, kidnaps: 0,
        motion: [0, 0, 0], slow: EXPECTED, fast: null, injected: 0, history: [], ready: false,
        points_b: new Float64Array(0), trace: [],
      });
      this.park(START, ROUTE);
      this.poses = this.everywhere(first);
      this.logWeights = new Float64Array(first).fill(-Math.log(first));
      this.work = this.looking();
      this.goOn();
    }

    get weights() {
      if (this.weighed !== this.logWeights) Object.assign(this, {weighed: this.logWeights, kept: this.logWeights.map(Math.exp)});
      return this.kept;
    }

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

    /** One sixtieth of a second of driving, and the next part of a look. */
    tick() {
      this.goOn();
      this.ticks += 1;
      const dt = 1 / HERTZ, [v, omega] = this.command();
      const bumped = this.moveTo(Array.from(core.motionModel(this.truth, v, omega, dt)));
      const noise = this.worldDice.normals(2), moved = bumped ? 0 : v * dt * (1 + 0.05 * noise[0]);
      this.motion = core.compose(this.motion, [moved, 0, omega * dt + 0.003 * noise[1] * Math.abs(v) * dt * HERTZ]);
      if (this.ticks % LOOK === 0 && (Math.hypot(...this.motion.slice(0, 2)) > 0.1 || Math.abs(this.motion[2]) > 0.1)) {
        this.finish();
        this.work = this.looking();
        this.goOn();
      }
    }

    /** The next part of a look, if one is under way. */
    goOn() {
      if (this.work && this.work.next().done) Object.assign(this, {work: null, ready: true});
    }

    finish() { while (this.work) this.goOn(); }

    /** A whole look at once. */
    look() {
      this.finish();
      this.work = this.looking();
      this.finish();
    }

    /** A look, part by part: take a scan, predict by the motion since the last one, weigh, and draw the cloud anew where it
     * needs it. What it finds is of the moment of the scan. */
    *looking() {
      const {motion, truth, dice, looks} = this, n = this.logWeights.length, before = this.poses;
      const seen_b = core.scanPoints(world.scan(truth, this.worldDice, this.walls), LIDAR), points_b = seen_b.filter((_, k) => Math.floor(k / 2) % EVERY === 0);
      Object.assign(this, {seen_b, points_b, motion: [0, 0, 0], looks: looks + 1});
      let poses = before, normals = null;
      if (looks) {
        normals = dice.normals(3 * n);
        yield;
        const metres = Math.hypot(motion[0], motion[1]);
        const xy = NOISE.xy + NOISE.xyPerMetre * metres, yaw = NOISE.yaw + NOISE.yawPerRadian * Math.abs(motion[2]) + NOISE.yawPerMetre * metres;
        const sigmas = [xy, xy, yaw];
        poses = core.composeEach(before, normals.map((normal, k) => motion[k % 3] + sigmas[k % 3] * normal));
        yield;
      }
      const gain = new Float64Array(n);
      for (let k = 0; k < n && points_b.length; k += PART) {
        gain.set(core.lostLogLikelihood(FIELD, SPEC, FREE, points_b, poses.subarray(3 * k, 3 * (k + PART)), MODEL), k);
        yield;
      }
      this.poses = poses;
      if (looks) this.note({motion, normals, before});
      if (points_b.length && this.weigh(gain, truth)) yield* this.resampling();
    }

    /** Weigh the cloud by what the scan gains at each pose; whether it has to be drawn anew. */
    weigh(gain, truth) {
      const {logWeights, logEvidence} = core.reweight(this.logWeights, gain), {points_b, poses} = this;
      this.logWeights = logWeights;
      const fit = Math.exp(logEvidence / MODEL.beams);
      this.slow += SLOW * (fit - this.slow);
      this.fast = this.fast === null ? fit : this.fast + FAST * (fit - this.fast);
      this.injected = this.settings.inject ? Math.max(0, 1 - this.fast / this.slow) : 0;
      this.history.push(this.sharesAt(truth));
      if (this.history.length > VALUES) this.history.shift();
      this.note({points: points_b, poses, logWeights});
      return this.injected > 0 || core.effectiveSampleSize(this.weights) <= 0.5 * logWeights.length;
    }

    /** Draw the cloud anew, part by part: as many as its bins ask for, and a share of them from the whole map. */
    *resampling() {
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
        yield;
        const trial = drawn(most);
        yield;
        for (let k = most - 1; k > 0; k--) {  // in any order: a heap after the other would be counted too soon
          const other = Math.floor(dice.uniform() * (k + 1));
          for (let c = 0; c < 3; c++) {
            const value = trial[3 * k + c];
            trial[3 * k + c] = trial[3 * other + c];
            trial[3 * other + c] = value;
          }
        }
        yield;
        number = core.enough(trial, Math.min(LEAST, most));
      }
      yield;
      this.poses = drawn(number);
      this.logWeights = new Float64Array(number).fill(-Math.log(number));
    }

    /** The shares of the weight within a metre of the robot, and of its twin half a turn round. */
    get shares() {
      const {weights, poses, truth, shared} = this, now = [weights, poses, truth];
      if (!shared || now.some((part, k) => part !== shared.now[k])) this.shared = {now, shares: this.sharesAt(truth)};
      return this.shared.shares;
    }

    sharesAt(truth) {
      const {weights, poses} = this;
      return [truth, twin(truth)].map(([x, y, theta]) => weights.reduce((sum, weight, k) => {
        const dx = poses[3 * k] - x, dy = poses[3 * k + 1] - y;
        return dx * dx + dy * dy < NEAR * NEAR && Math.abs(core.wrapAngle(poses[3 * k + 2] - theta)) < 0.5 ? sum + weight : sum;
      }, 0));
    }

    /** Somebody carries the robot to a pose: neither wheels nor gyro notice. */
    carry(pose) { Object.assign(this, {truth: pose.slice(), way: [], target: null}); }

    kidnap() {
      if (!world.room(PLACES[this.kidnaps % PLACES.length], this.walls)) this.kidnaps += 1;  // the cupboard stands there
      this.carry(PLACES[this.kidnaps % PLACES.length]);
      Object.assign(this, {kidnaps: this.kidnaps + 1, leg: this.kidnaps % 2 ? 5 : 3});
    }

    note(event) { if (this.settings.trace) this.trace.push(event); }
  }

  lab("lost", stage => {
    const search = new Search(stage.options), {settings} = search;
    const plan = stage.plan({
      name: "The building with the particles, the robot, and its twin half a turn round",
      help: "Tap a place, or use the arrow keys, to drive. Drag the robot to carry it away. Where can it tell itself from its twin? " +
        "Drag the cupboard by its ring, or press Q and E, to push it along the corridor: the map does not know it.",
      window: WINDOW,
    });
    stage.words([dot("particles", "<b>Each dot is a guess</b>."), dot("truth", "the robot, which the filter cannot see."),
                 dot("highlight", "its twin, half a turn round.")].join(" "));
    const strip = stage.chart({name: "The share of the weight at the robot, and at its twin, over the last scans", height: 64});
    strip.write(`Share of the weight: ${dot("truth", "at the robot,")} ${dot("highlight", "at its twin.")}`);
    const clock = stage.clock({hertz: HERTZ, tick: () => search.tick(), step: () => { for (let k = 0; k < HERTZ / 2; k++) search.tick(); }});
    stage.button({name: "Kidnap", key: "k", press: () => { search.kidnap(); clock.wake(); }});
    stage.check({name: "Inject", key: "i", value: true, change: value => { settings.inject = value; }});
    stage.fold("More");
    clock.fold();
    stage.check({name: "Number by KLD", key: "l", value: true, change: value => { settings.adaptive = value; }});
    stage.button({name: "Start again", key: "n", press: () => { search.reset(); auto.checked = true; }});
    stage.button({name: "New dice", key: "d", press: () => { settings.seed += 1; search.reset(); auto.checked = true; }});
    stage.slider({name: "Particles at first", min: 100, max: 20000, step: 100, value: settings.first, digits: 0,
                  change: value => { settings.first = value; search.reset(); auto.checked = true; }});
    const cupboard = stage.slider({name: "Cupboard pushed", min: 0, max: 100, step: 1, value: 0, unit: "%", digits: 0, change: value => {
      search.push(value);
      turn(cupboard, settings.pushed);
    }});
    const robot = {
      grab: (x, y) => plan.near(x, y, search.truth),
      take() {
        const {truth} = search;
        return () => search.carry(truth);
      },
      move(x, y) { if (world.room([x, y], search.walls)) search.carry([x, y, search.truth[2]]); },
    };
    const pushed = {
      grab: (x, y) => plan.near(x, y, search.heart),
      take() {
        const before = settings.pushed;
        return () => turn(cupboard, before);
      },
      move: x => turn(cupboard, (100 * (x - HEART[0])) / ACROSS[0]),
    };
    const auto = stage.driven(plan, search, clock, [robot, pushed]);
    const push = by => down => { if (down) turn(cupboard, settings.pushed + by); };
    stage.keys(plan, {q: push(5), e: push(-5)});
    return {
      state: search,
      constants: {SPEC, LIDAR, MODEL, NOISE, LEAST, logOdds: GRID.logOdds},
      draw() {
        if (!search.ready) {
          search.goOn();
          stage.redraw();
        }
        paint(plan, stage.colours, search);
        paintShares(strip, stage.colours, search);
      },
      describe: () => sentence(search),
    };
  });

  function paint(plan, colours, search) {
    const {truth, seen_b, points_b} = search;
    world.paint(plan, colours);
    paintCupboard(plan, colours, search);
    draw.rays(plan, core.transformPoints(truth, LIDAR.position), core.transformPoints(truth, points_b), colours.clear);
    draw.dots(plan, core.transformPoints(truth, seen_b), colours.hits, 1.8);
    draw.kept(plan, [search.poses, colours], sheet => paintCloud(sheet, colours, search.poses));
    world.robot(plan, twin(truth), colours, "highlight");
    world.robot(plan, truth, colours, "truth");
    if (search.target) draw.dots(plan, search.target, colours.highlight, 6);
    plan.write(news(search));
  }

  function paintCloud(plan, colours, poses) {
    const n = poses.length / 3, places = new Float64Array(2 * n);
    for (let k = 0; k < n; k++) { places[2 * k] = poses[3 * k]; places[2 * k + 1] = poses[3 * k + 1]; }
    if (n > 3000) draw.specks(plan, places, colours.particles, 1.8);
    else draw.dots(plan, places, colours.particles, 2.2, {colour: colours.estimate, width: 0.75});
  }

  /** The cupboard where it stands, which the map may not know, with its knob. */
  function paintCupboard(plan, colours, {cupboard, heart}) {
    draw.line(plan, [...cupboard, cupboard[0]].flat(), colours.truth, {width: 2});
    draw.knob(plan, heart, colours, "truth");
  }

  /** What happens, in a line. */
  function news(search) {
    const {refused, injected, logWeights} = search, [here, there] = search.shares, n = logWeights.length.toLocaleString("en");
    if (refused) return refused;
    if (search.looks > 1 && injected > 0.02) return `The scan fits badly: ${(100 * injected).toFixed(0)} % of ${n} guesses are new, from everywhere.`;
    if (here + there < 0.8) return `${n} guesses, all over the building.`;
    if (Math.min(here, there) > 0.05) return `${n} guesses in two heaps: ${(100 * here).toFixed(0)} % at the robot, ${(100 * there).toFixed(0)} % at its twin.`;
    return here > there ? `Found: ${(100 * here).toFixed(0)} % at the robot. An end of the corridor told it from its twin.`
      : `Sure, and wrong: ${(100 * there).toFixed(0)} % at the twin.${search.settings.pushed ? " The map has the cupboard at its old place." : ""}`;
  }

  /** The two shares over the last scans. */
  function paintShares(strip, colours, search) {
    strip.clear(colours.sheet);
    ["truth", "highlight"].forEach((name, k) => {
      draw.strip(strip, search.history.map(shares => shares[k]), {room: VALUES, top: 1, level: 0.5, colour: colours[name], levelColour: colours.muted});
    });
  }

  function sentence(search) {
    const [here, there] = search.shares.map(share => (100 * share).toFixed(0));
    const {pushed} = search.settings;
    return `${search.logWeights.length} particles; ${here} percent of the weight lie at the robot and ${there} percent at its twin half a turn round.` +
      (pushed ? ` The cupboard was pushed ${pushed} percent of the way to the left end; the map does not know it.` : "");
  }
})(globalThis);
