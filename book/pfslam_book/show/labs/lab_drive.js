/* Drive (chapter 05, and in small on the first page, where `story.js` tells it): a robot in a building of walls, and the
 * filter that follows it. */
(function (root) {
  "use strict";
  const {core, draw, lab, world} = root.pfslam, {WINDOW, SPEC, LIDAR, RADIUS, START, WALLS, dot} = world;

  const HERTZ = 60, LOOK = 12, OPENING = 14 * HERTZ;  // ticks in a second; from one scan to the next; before the reader comes
  const TRAIL = 60 * HERTZ, VALUES = 80;  // ticks of odometry, and values of N_eff, that are kept: a drive may go on for hours
  const EVERY = 3;  // of so many beams one is scored; all are drawn
  const HIT = Math.log(4), CLAMP = 2 * Math.log(4);
  const NEAR = 1.4;  // m to each side of a robot that is looked at closely
  const SLIPPERY = [3.2, 2.275, 5.4, 3.725];  // x0, y0, x1, y1 of the patch
  const ROUTE = [[7.3, 3], [7.3, 4.8], [4.8, 4.8], [2.1, 4.8], [2.1, 3.1], [1.7, 2.8], [1.7, 1.2], [4.2, 1.2], [6.9, 1.2],
                 [6.9, 2.8], [8, 3.3], [7, 3.1], [0.8, 3]];
  const PLACES = [[7.6, 5.4, 3], [1.5, 0.6, 0.5], [3.9, 5.4, 0], [7.6, 1.6, 2], [5, 0.9, 0.2]];  // where a kidnapper leaves it
  const CAMERA = {near: 0.35, far: 1.5, aside: 0.75};  // m ahead, m to each side at the far end
  const PEOPLE = [[2.6, 2.6, 7.6, 3.4, 0.5], [5.6, 4.2, 8.2, 4.6, 0.3], [2.6, 0.5, 3.2, 1.9, 0.4]];  // from, to, m/s

  /** The world, the robot in it, and its filter. Everything that chance decides comes from two seeded generators. */
  class Drive extends world.Driver {
    constructor(options, parts = {}) {
      super();
      this.settings = {particles: 200, noise: 1, sharpness: 12, threshold: 0.5, free: 0.4, people: false, slip: false,
                       ...options};
      this.parts = parts;
      this.reset();
    }

    /** Back to the start: an empty map, all particles where the robot is. */
    reset() {
      const {seed = 1, start = START, leg = 0} = this.settings;
      Object.assign(this, {
        worldDice: core.generator(seed), filterDice: core.generator(seed + 1), ticks: 0, looks: 0, resamplings: 0,
        reckoned: [start.slice()], kidnaps: 0, before: null, floor: {data: new Uint8ClampedArray(world.floor().colours.length)},
        points_b: new Float64Array(0), history: [], trace: [], moved: true, waiting: false, said: "",
        grid: {spec: SPEC, logOdds: new Float32Array(SPEC.shape[0] * SPEC.shape[1])},
      });
      this.park(start, ROUTE, leg);
      this.gather(start);
    }

    /** All particles at one pose, with equal weights. */
    gather(pose) {
      const n = this.settings.particles;
      this.poses = Float64Array.from({length: 3 * n}, (_, k) => pose[k % 3]);
      this.logWeights = new Float64Array(n).fill(-Math.log(n));
    }

    /** Weights and estimate are worked out where they are needed, and kept until particles or weights change. */
    get weights() {
      if (this.weighed !== this.logWeights) {
        this.weighed = this.logWeights;
        this.kept = this.logWeights.map(Math.exp);
        this.averaged = null;
      }
      return this.kept;
    }

    /** The weighted mean of the particles [x, y, theta]. */
    get estimate() {
      const {weights} = this;
      if (this.averaged !== this.poses) {
        this.averaged = this.poses;
        this.mean = core.averagePose(this.poses, weights);
      }
      return this.mean;
    }

    get nEff() { return core.effectiveSampleSize(this.weights); }

    /** Walking people, as discs x, y, radius. */
    get discs() {
      if (!this.settings.people) return [];
      return PEOPLE.flatMap(([x0, y0, x1, y1, speed]) => {
        const way = (this.ticks / HERTZ) * speed / Math.hypot(x1 - x0, y1 - y0), part = Math.abs(((way + 1) % 2) - 1);
        return [x0 + part * (x1 - x0), y0 + part * (y1 - y0), 0.18];
      });
    }

    /** One sixtieth of a second: the robot moves, its wheels and gyro report, every particle is predicted. Without `look`
     * no scan is taken. */
    tick(look = true) {
      if (this.waiting) return;
      this.ticks += 1;
      const dt = 1 / HERTZ, [v, omega] = this.command();
      if (v || omega) {
        const [x0, y0, x1, y1] = SLIPPERY, [x, y] = this.truth;
        const slips = this.settings.slip && x > x0 && x < x1 && y > y0 && y < y1;
        const next = Array.from(core.motionModel(this.truth, slips ? 0.75 * v : v, slips ? omega + 0.3 * v : omega, dt));
        const bumped = this.moveTo(next);
        const noise = this.worldDice.normals(2);
        this.predict((bumped ? 0 : 1.03 * v) + 0.1 * noise[0], omega + 0.012 + 0.1 * noise[1], dt);
      }
      if (look && this.ticks % LOOK === 0 && this.moved) this.look();
    }

    /** Eq. 11: every particle by its own noisy control. */
    predict(v, omega, dt) {
      const {particles, noise} = this.settings, normals = this.filterDice.normals(2 * particles);
      const sigmas = {sigmaV: 0.13 * noise, sigmaOmega: 0.25 * noise, perRootSecond: true};
      this.poses = core.predict(this.poses, v, omega, dt, sigmas, normals);
      this.reckoned.push(Array.from(core.motionModel(this.reckoned[this.reckoned.length - 1], v, omega, dt)));
      if (this.reckoned.length > 2 * TRAIL) this.reckoned.splice(0, TRAIL);
      this.moved = true;
      this.note({v, omega, dt, sigmas, normals});
    }

    /** What the LiDAR measures where the robot truly is: end points in the body frame. */
    scan() {
      const ranges = world.scan(this.truth, this.worldDice, WALLS, this.discs);
      this.points_b = core.scanPoints(ranges, LIDAR);
      this.note({ranges});
    }

    /** A scan as the filter takes it: score, resample if few particles carry the weight. A `blind` one does not compare: it
     * only draws. */
    look() {
      this.scan();
      if (this.settings.blind) { this.moved = false; this.looks += 1; this.draw(); return; }
      this.score(() => { if (this.nEff <= this.settings.threshold * this.settings.particles) this.resample(); });
    }

    /** Weigh every particle by how well the scan fits the map from there (Eq. 12), and draw the scan into the map. */
    score(next = () => {}) {
      const occupied = core.occupied(this.grid), {sharpness} = this.settings;
      this.moved = false;
      this.looks += 1;
      if (!occupied.includes(1)) { this.draw(); next(); return; }
      const few = this.points_b.filter((_, k) => Math.floor(k / 2) % EVERY === 0);
      const field = core.scoreField(occupied, SPEC, "distance");
      const gain = core.logLikelihood(core.scores(field, SPEC, few, this.poses), 500 * few.length, sharpness);
      this.fit = Math.max(...gain) / sharpness;
      this.after(this.parts.update && this.parts.update(this.weights, gain.map(Math.exp)), weights => {
        this.logWeights = weights ? weights[0].map(Math.log) : core.reweight(this.logWeights, gain).logWeights;
        this.remember();
        this.note({scored: true, sharpness});
        this.draw();
        next();
      });
    }

    /** Write the scan into the map from the estimate (Eq. 15). */
    draw() {
      const points_w = core.transformPoints(this.estimate, this.points_b), {free} = this.settings;
      const sensor = core.transformPoints(this.estimate, LIDAR.position);
      this.grid = core.integrateScan(this.grid, points_w, sensor, {hit: HIT, free, clamp: CLAMP});
      this.note({free});
      this.paintFloor();
    }

    /** What the camera sees of the floor from where the robot is goes into the picture where the filter believes it to be. */
    paintFloor() {
      const {estimate, truth, grid, floor} = this, {near, far, aside} = CAMERA, FLOOR = world.floor(), step = FLOOR.tile, places = [];
      for (let ahead = near; ahead < far; ahead += step) {
        const reach = (aside * ahead) / far;
        for (let across = -reach; across <= reach; across += step) places.push(ahead, across);
      }
      const real = core.transformPoints(truth, places), drawn = core.transformPoints(estimate, places);
      const cells = core.worldToCell(SPEC, drawn), pixels = core.worldToCell(FLOOR.spec, drawn), seen = core.worldToCell(FLOOR.spec, real);
      for (let k = 0; k < places.length; k += 2) {
        if (!core.contains(SPEC, cells[k], cells[k + 1]) || !core.contains(FLOOR.spec, seen[k], seen[k + 1])) continue;
        if (!(grid.logOdds[cells[k + 1] * SPEC.shape[1] + cells[k]] < 0)) continue;
        const from = 4 * ((FLOOR.height - 1 - seen[k + 1]) * FLOOR.width + seen[k]);
        floor.data.set(FLOOR.colours.subarray(from, from + 4), 4 * ((FLOOR.height - 1 - pixels[k + 1]) * FLOOR.width + pixels[k]));
      }
      floor.changed = true;
    }

    /** Draw the particles anew by their weights: heavy ones several times, light ones never; then all weigh the same. */
    resample() {
      const u = this.filterDice.uniform();
      this.after(this.parts.resample && this.parts.resample(this.poses, this.weights), drawn => {
        this.poses = drawn ? drawn[0] : core.chosen(this.poses, core.systematicResample(this.weights, u));
        this.logWeights = drawn ? drawn[1].map(Math.log) : this.logWeights.map(() => -Math.log(this.logWeights.length));
        this.resamplings += 1;
        this.remember();
        this.note({u});
      });
    }

    remember() {
      this.history.push(this.nEff);
      if (this.history.length > VALUES) this.history.shift();
    }

    /** Go on with a value; if somebody else is still working it out, nothing moves until it is there. */
    after(value, next) {
      if (!value || !value.then) { next(value); return; }
      this.waiting = true;
      value.then(result => { this.waiting = false; next(result); }, error => { this.said = String(error); });
    }

    /** Lift the robot and put it down elsewhere: wheels and gyro notice nothing. */
    kidnap() {
      const {truth, poses, logWeights, grid, reckoned, floor} = this;
      this.before = {truth, poses, logWeights, grid, reckoned: reckoned.slice(), floor: {data: floor.data.slice(), changed: true}};
      this.truth = PLACES[this.kidnaps % PLACES.length].slice();
      Object.assign(this, {way: [], leg: this.truth[1] > 3.8 ? 2 : 8, target: null});
      this.kidnaps += 1;
    }

    /** Put it back where it was taken, with the map and the particles of that moment. */
    putBack() {
      Object.assign(this, this.before, {before: null, way: [], leg: this.before.truth[1] > 3.8 ? 2 : 8, target: null});
      this.note({putBack: true});
    }

    /** How far the estimate, and odometry alone, are from the truth, m. */
    get off() { return Math.hypot(this.estimate[0] - this.truth[0], this.estimate[1] - this.truth[1]); }
    get offAlone() {
      const [x, y] = this.reckoned[this.reckoned.length - 1];
      return Math.hypot(x - this.truth[0], y - this.truth[1]);
    }

    /** Put so many particles into the cloud, drawn from those that there are. */
    setParticles(n) {
      this.settings.particles = n;
      const {weights} = this, many = Float64Array.from({length: n}, (_, k) => weights[k % weights.length]);
      const total = many.reduce((a, b) => a + b, 0);
      this.poses = Float64Array.from({length: 3 * n}, (_, k) => this.poses[k % this.poses.length]);
      this.logWeights = many.map(weight => Math.log(weight / total));
      this.note({particles: n});
    }

    /** For tests: what happened, in order, with all random numbers, if the option `trace` asks for it. */
    note(event) { if (this.settings.trace) this.trace.push(event); }
  }

  lab("drive", stage => {
    const plan = stage.plan({
      name: "Plan of the building with the map so far, the robot, its beams and the particles",
      help: "Drive: tap a place, and the robot goes there; or use the arrow keys.",
      window: WINDOW,
    });
    const constants = {SPEC, LIDAR, EVERY, HIT, CLAMP, START};
    if (stage.small) return Object.assign(root.pfslam.story(stage, plan, {Drive, HERTZ, ROUTE, CLAMP, paint, paintFloor, news}), {constants});
    const drive = new Drive(stage.options, stage.host), shown = {truth: false, near: false, floor: false};
    drive.ready = Boolean(stage.options.empty) || Object.keys(drive.parts).length > 0;  // else a drive is under way when the reader comes
    stage.words([
      dot("particles", "<b>Each blue dot is a guess</b> of where the robot is; the larger, the better its view fits."),
      dot("hits", "where a beam ended."), dot("wall", "walls of the map."),
    ].join(" "));
    const strip = stage.chart({name: "The last values of N_eff, the number of particles that count", height: 56});
    strip.canvas.dataset.layer = "n-eff";

    const clock = stage.clock({hertz: HERTZ, tick: () => drive.tick(), step: () => move(HERTZ)});
    function move(ticks, look = true) { for (let k = 0; k < ticks; k++) drive.tick(look); }

    const byHand = action => () => { clock.pause(); action(); };
    const thief = stage.button({name: "Kidnap", key: "k", press: () => (drive.before ? drive.putBack() : drive.kidnap())});
    stage.button({name: "Start again", key: "n", press: () => { drive.reset(); auto.checked = true; }});
    stage.fold("More");
    clock.fold();
    stage.button({name: "Predict", key: "p", press: byHand(() => move(LOOK, false))});
    stage.button({name: "Score", key: "s", press: byHand(() => { drive.scan(); drive.score(); })});
    stage.button({name: "Resample", key: "r", press: byHand(() => drive.resample())});
    const auto = stage.driven(plan, drive, clock);
    stage.check({name: "Show the truth", key: "t", change: value => { shown.truth = value; }});
    stage.check({name: "Look closely", key: "z", change: value => { shown.near = value; }});
    stage.check({name: "Floor", key: "f", change: value => { shown.floor = value; }});
    controls(stage, drive);

    return {
      state: drive,
      constants,
      draw() {
        if (!drive.ready) {
          move(HERTZ / 4);  // in each frame: all at once would hold the page up
          drive.ready = drive.ticks >= OPENING;
          stage.redraw();
        }
        thief.firstChild.data = drive.before ? "Put it back " : "Kidnap ";
        plan.window = shown.near ? world.near(drive.estimate, NEAR) : WINDOW;
        paint(plan, stage.colours, drive, shown);
        const yours = Object.keys(drive.parts);
        plan.write(news(drive, stage.calm).join(" ") + (yours.length ? ` <i>Yours: ${yours.join(", ")}.</i>` : ""));
        paintStrip(strip, stage.colours, drive);
      },
      describe: () => sentence(drive, shown),
    };
  });

  function controls(stage, drive) {
    const {settings} = drive;
    stage.slider({name: "Noise", min: 0, max: 3, step: 0.05, value: settings.noise, unit: "times",
                  change: value => { settings.noise = value; }});
    stage.slider({name: "Particles", min: 10, max: 2000, step: 10, value: settings.particles, digits: 0,
                  change: value => drive.setParticles(value)});
    stage.slider({name: "Sharpness", min: 0, max: 40, step: 0.5, value: settings.sharpness, digits: 1,
                  change: value => { settings.sharpness = value; }});
    stage.slider({name: "Resample below", min: 0, max: 1, step: 0.01, value: settings.threshold, unit: "of N",
                  change: value => { settings.threshold = value; }});
    stage.slider({name: "Clearing", min: 0, max: 1.4, step: 0.05, value: settings.free, unit: "log-odds",
                  change: value => { settings.free = value; }});
    stage.slider({name: "Speed", min: 0.1, max: 2, step: 0.1, value: 1, unit: "times", digits: 1,
                  change: value => { stage.beat.speed = value; }});
    stage.check({name: "Slippery patch", change: value => { settings.slip = value; }});
    stage.check({name: "People", change: value => { settings.people = value; }});
  }

  /** The plan: the map, what the robot sees, and the particles. `shown` says what else, or less: the truth, the last ticks that
   * wheels and gyro drove `alone`, the floor. */
  function paint(plan, colours, drive, shown) {
    const {estimate, settings} = drive, {map = true, scan = true, truth = false, alone = truth ? TRAIL : 0} = shown;
    plan.clear(colours.paper);
    if (map) draw.grid(plan, drive.grid, colours, CLAMP);
    if (shown.floor) paintFloor(plan, drive.floor);
    if (settings.slip) hatch(plan, SLIPPERY, colours.odometry);
    const points_w = core.transformPoints(estimate, drive.points_b), sensor = core.transformPoints(estimate, LIDAR.position);
    if (scan && drive.looks) draw.rays(plan, sensor, points_w, colours.clear);
    if (alone) {
      const {reckoned} = drive, line = [];
      for (let k = 6 * Math.ceil(Math.max(0, reckoned.length - alone) / 6); k < reckoned.length; k += 6) line.push(reckoned[k][0], reckoned[k][1]);
      draw.line(plan, line, colours.odometry, {dash: [7, 4]});
    }
    if (truth) {
      draw.line(plan, WALLS, colours.truth, {width: 1, gaps: true});
      const {discs} = drive;
      for (let k = 0; k < discs.length; k += 3) draw.robot(plan, [discs[k], discs[k + 1], 0], colours.muted, {radius: 0.18});
    }
    if (truth || drive.before) world.robot(plan, drive.truth, colours, "truth");
    if (scan) draw.dots(plan, points_w, colours.hits, 1.8);
    draw.robot(plan, estimate, colours.estimate, {radius: RADIUS});  // through it one sees the particles
    const few = settings.particles <= 500, single = settings.particles <= 100;
    draw.particles(plan, drive.poses, drive.weights, colours, {
      radius: (single ? 3.2 : few ? 2.5 : 1.5) * (shown.near ? 1.5 : 1), headings: shown.near && few, rims: single || (few && plan.scale > 50),
    });
    if (drive.target) {
      const [x, y] = plan.at(...drive.target);
      Object.assign(plan.context, {strokeStyle: colours.highlight, lineWidth: 3});
      plan.context.strokeRect(x - 7, y - 7, 14, 14);
    }
  }

  /** What happens, in a sentence or two: nobody leaves the map in ruins without being told why. */
  function news(drive, calm) {
    const {off, offAlone} = drive, metres = value => (value < 1 ? `${(100 * value).toFixed(0)} cm` : `${value.toFixed(1)} m`);
    if (drive.said) return [drive.said];
    if (drive.refused) return [drive.refused];
    if (!drive.looks) return [`An empty map. Press ${calm ? "Step" : "Start"}.`];
    if (drive.before) return ["Carried away: the dots cannot know it.", "Put it back, or watch the map being spoilt."];
    if (off > 0.6) return [`Lost: the dots are ${metres(off)} off, and the map is spoilt.`, "Start again."];
    return [`Dots ${metres(off)} off, wheels and gyro alone ${metres(offAlone)}.`];
  }

  /** The picture of the floor so far, under the robot. */
  function paintFloor(plan, floor) {
    const {width, height} = world.floor(), [x, y] = plan.at(SPEC.origin[0], SPEC.origin[1] + SPEC.shape[0] * SPEC.resolution);
    if (!floor.canvas) floor.canvas = Object.assign(document.createElement("canvas"), {width, height});
    if (floor.changed) {
      floor.canvas.getContext("2d").putImageData(new ImageData(floor.data, width, height), 0, 0);
      floor.changed = false;
    }
    plan.context.imageSmoothingEnabled = true;
    plan.context.drawImage(floor.canvas, x, y, SPEC.shape[1] * SPEC.resolution * plan.scale, SPEC.shape[0] * SPEC.resolution * plan.scale);
  }

  function paintStrip(strip, colours, drive) {
    const {particles, threshold} = drive.settings, level = threshold * particles;
    strip.clear(colours.paper);
    draw.strip(strip, drive.history, {room: VALUES, top: particles, level, colour: colours.estimate, levelColour: colours.ink});
    strip.write(`<i>N</i><sub>eff</sub>: ${drive.nEff.toFixed(0)} of ${particles} particles count.`);
  }

  /** Slanted lines across a rectangle x0, y0, x1, y1 of the world. */
  function hatch(plan, [x0, y0, x1, y1], colour) {
    const lines = [];
    for (let x = x0; x + 0.3 <= x1 + 1e-9; x += 0.2) lines.push(x, y0, x + 0.3, y1);
    plan.context.globalAlpha = 0.5;
    draw.line(plan, lines, colour, {width: 1, gaps: true});
    plan.context.globalAlpha = 1;
  }

  function sentence(drive, shown) {
    if (drive.said || drive.refused) return drive.said || drive.refused;
    if (!drive.looks) return "The map is empty. The robot stands at the left end of a corridor.";
    const {poses, weights, estimate} = drive;
    const spread = Math.sqrt(weights.reduce((sum, w, k) =>
      sum + w * ((poses[3 * k] - estimate[0]) ** 2 + (poses[3 * k + 1] - estimate[1]) ** 2), 0));
    return `The estimate is at ${estimate[0].toFixed(1)}, ${estimate[1].toFixed(1)} metres; the particles spread over ` +
      `${(100 * spread).toFixed(0)} centimetres, and ${drive.nEff.toFixed(0)} of ${weights.length} count` +
      (drive.before ? "; the robot was carried away" : "") + (shown.truth ? `; it is off by ${(100 * drive.off).toFixed(0)} centimetres.` : ".");
  }
})(globalThis);
