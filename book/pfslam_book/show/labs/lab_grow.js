/* A map grows (chapter 02): drive through a small building, scan by scan; each cell has a diary. */
(function (root) {
  "use strict";
  const {core, draw, lab, world} = root.pfslam, {WINDOW, SPEC, LIDAR, RADIUS, START, WALLS, dot} = world;

  const LOG_4 = Math.log(4), CELL = [38, 52];  // a cell of the door
  // What can be opened: x1, y1, x2, y2 (m) from the hinge to the handle, shut and open.
  const LEAVES = {door: {shut: [1.2, 2.2, 2.2, 2.2], open: [1.2, 2.2, 1.2, 1.2]}, panel: {shut: [4.2, 0.7, 4.2, 1.7], open: [4.2, 0.7, 5.2, 0.7]}};
  const STEP = 0.1, MOST = 600;  // m from one scan to the next while it drives; scans for which a survey has room
  const SEEN = 3;  // so many scans must hit a cell of a wall for it to be seen wall
  const LINES = 3;  // of the diary, in words

  /** A robot in a building, all that its scans have said, and the map of it. */
  class Survey {
    constructor({seed = 2, trace = false}) {
      Object.assign(this, {seed, pose: START.slice(), cell: CELL.slice(), open: {door: false, panel: false}, driven: false});
      this.settings = {hit: 1, free: 1, clamp: 2};  // in log 4
      this.trace = trace ? [] : null;
      this.reset();
    }

    /** An empty map; the robot stays where it is. */
    reset() {
      Object.assign(this, {dice: core.generator(this.seed), said: [], hits: new Uint16Array(SPEC.shape[0] * SPEC.shape[1])});
      if (this.trace) this.trace.length = 0;
      this.write();
    }

    get config() {
      const {hit, free, clamp} = this.settings;
      return {hit: hit * LOG_4, free: free * LOG_4, clamp: clamp * LOG_4};
    }

    get walls() {
      const shut = Object.keys(LEAVES).filter(name => !this.open[name]), key = shut.join();
      if (this.shut !== key) Object.assign(this, {shut: key, built: Float64Array.from([...WALLS, ...shut.flatMap(name => LEAVES[name].shut)])});
      return this.built;
    }

    get full() { return this.said.length >= MOST; }

    /** The map of all scans, written anew with the present settings. */
    write() {
      this.grid = {spec: SPEC, logOdds: new Float32Array(SPEC.shape[0] * SPEC.shape[1])};
      for (const said of this.said) this.grid = core.addEvidence(this.grid, said, this.config);
    }

    set(name, value) {
      this.settings[name] = value;
      this.write();
    }

    /** Look round once and write the scan into the map. Eq. 7, 14, 15. */
    scan() {
      if (this.full) return;
      const {pose, walls} = this, ranges = world.scan(pose, this.dice, walls);
      this.points_w = core.transformPoints(pose, core.scanPoints(ranges, LIDAR));
      const said = core.evidence(SPEC, this.points_w, core.transformPoints(pose, LIDAR.position));
      this.said.push(said);
      said.forEach((word, k) => { if (word > 0) this.hits[k] += 1; });
      this.grid = core.addEvidence(this.grid, said, this.config);
      if (this.trace) this.trace.push({pose: pose.slice(), ranges});
    }

    /** Drive towards a place, step by step with a scan at each, along the walls where they are in the way. */
    drive(x, y) {
      for (let left = Math.hypot(x - this.pose[0], y - this.pose[1]) / STEP; left >= 1; left--) {
        const dx = x - this.pose[0], dy = y - this.pose[1], far = Math.hypot(dx, dy), step = [(STEP * dx) / far, (STEP * dy) / far];
        const ways = [step, [step[0], 0], [0, step[1]]];
        const way = far >= STEP && !this.full && ways.find(([a, b]) =>
          Math.hypot(a, b) > 0.2 * STEP && !core.touches(this.walls, [this.pose[0] + a, this.pose[1] + b], RADIUS));
        if (!way) return;
        this.pose = [this.pose[0] + way[0], this.pose[1] + way[1], Math.atan2(dy, dx)];
        this.driven = true;
        this.scan();
      }
    }

    choose(ix, iy) { if (core.contains(SPEC, ix, iy)) this.cell = [ix, iy]; }

    /** What the scans said about the chosen cell, and its log-odds after each, in log 4. */
    get diary() {
      const {grid, cell: [ix, iy], read} = this;
      if (read && read.grid === grid && read.at === iy * SPEC.shape[1] + ix) return read.pages;
      const at = iy * SPEC.shape[1] + ix, pages = [];
      let cell = {spec: {...SPEC, shape: [1, 1]}, logOdds: new Float32Array(1)};
      this.said.forEach((said, scan) => {
        if (!said[at]) return;
        cell = core.addEvidence(cell, said.subarray(at, at + 1), this.config);
        pages.push({scan: scan + 1, hit: said[at] > 0, level: cell.logOdds[0] / LOG_4});
      });
      this.read = {grid, at, pages};
      return pages;
    }

    get level() { return this.grid.logOdds[this.cell[1] * SPEC.shape[1] + this.cell[0]] / LOG_4; }

    /** Square metres that are free in the map. */
    get area() { return SPEC.resolution ** 2 * this.grid.logOdds.reduce((sum, value) => sum + (value < 0), 0); }

    /** The share of the walls' cells which three scans or more have hit that the map no longer shows. */
    get worn() {
      const {walls, grid, hits, counted} = this;
      if (counted && counted.grid === grid && counted.walls === walls) return counted.worn;
      const standing = counted && counted.walls === walls ? counted.standing : world.standing(walls);
      let wall = 0, lost = 0;
      hits.forEach((times, k) => {
        if (times < SEEN || !standing[k]) return;
        wall += 1;
        if (!(grid.logOdds[k] > 0)) lost += 1;
      });
      this.counted = {grid, walls, standing, worn: wall ? lost / wall : 0};
      return this.counted.worn;
    }
  }

  lab("grow", stage => {
    const survey = new Survey(stage.options), shown = {building: false, held: null, drawn: "", knot: 0, from: 0, to: 0, share: () => 1};
    const plan = stage.plan({
      name: "The map, the robot, and the chosen cell",
      help: "Drag the robot, or a door by its knob; point at any cell for its diary. Keys: arrows drive, A, D, W and S choose the next cell.",
      window: WINDOW,
    });
    const rope = stage.chart({name: "A rope at the chosen cell: hits pull to the right, passing beams to the left, up to the clamp", height: 42});
    const chart = stage.chart({name: "The log-odds of the chosen cell after each scan", height: 76});
    const diary = stage.words("");
    diary.classList.add("pfslam-diary");
    const clock = stage.clock({hertz: 10, tick: () => survey.scan(), step: () => survey.scan()});
    const slider = (key, name, min, max) => stage.slider({
      name, min, max, step: 0.01, value: survey.settings[key], unit: "log 4", change: value => survey.set(key, value)});
    slider("free", "Free", 0.01, 2);
    stage.fold("More");
    slider("hit", "Hit", 0.1, 3);
    slider("clamp", "Clamp", 0.5, 20);
    stage.button({name: "New map", key: "n", press: () => { survey.reset(); survey.scan(); }});
    const boxes = {door: ["Door open", "o"], panel: ["Second door open", "p"]};
    for (const [leaf, [name, key]] of Object.entries(boxes)) boxes[leaf] = stage.check({name, key, change: open => { survey.open[leaf] = open; }});
    stage.check({name: "Show the building", key: "b", change: value => { shown.building = value; }});
    const knobAt = (x, y) => Object.keys(LEAVES).find(leaf => plan.near(x, y, knob(leaf, survey.open[leaf])));
    const onRobot = (x, y) => plan.near(x, y, survey.pose);
    const hold = (x, y) => {
      if (shown.held === "robot") survey.drive(x, y);
      else if (!shown.held) survey.choose(...core.worldToCell(SPEC, [x, y]));
      else if (survey.open[shown.held] !== nearer(shown.held, x, y)) boxes[shown.held].click();
    };
    stage.drag(plan, {
      start: (x, y) => {
        shown.held = onRobot(x, y) ? "robot" : knobAt(x, y) || null;
        if (shown.held !== "robot") hold(x, y);
      },
      move: hold,
      grab: (x, y) => onRobot(x, y) || Boolean(knobAt(x, y)),
    });
    const go = (dx, dy) => down => {
      if (down) survey.drive(survey.pose[0] + 1.01 * STEP * dx, survey.pose[1] + 1.01 * STEP * dy);
    };
    const next = (dx, dy) => down => { if (down) survey.choose(survey.cell[0] + dx, survey.cell[1] + dy); };
    stage.keys(plan, {ArrowLeft: go(-1, 0), ArrowRight: go(1, 0), ArrowUp: go(0, 1), ArrowDown: go(0, -1),
                      a: next(-1, 0), d: next(1, 0), w: next(0, 1), s: next(0, -1)});
    survey.scan();
    return {
      state: survey, shown, constants: {SPEC, LIDAR, SEEN},
      draw() {
        if (survey.full) clock.pause();
        paintMap(plan, stage.colours, survey, shown);
        paintRope(rope, stage, survey, shown);
        paintDiary(chart, stage.colours, survey);
        const words = inWords(survey);
        if (words !== shown.drawn) diary.innerHTML = shown.drawn = words;
      },
      describe: () => sentence(survey),
    };
  });

  /** Where the knob of a leaf is, [x, y]. */
  const knob = (leaf, open) => LEAVES[leaf][open ? "open" : "shut"].slice(2);

  /** Whether a place is nearer to the knob of the leaf when it is open. */
  function nearer(leaf, x, y) {
    const [open, shut] = [true, false].map(state => Math.hypot(knob(leaf, state)[0] - x, knob(leaf, state)[1] - y));
    return open < shut;
  }

  function paintMap(plan, colours, survey, shown) {
    const {pose, grid, cell, settings, open} = survey;
    plan.clear(colours.paper);
    draw.grid(plan, grid, colours, LOG_4 * Math.min(settings.clamp, 2));
    if (shown.building) draw.line(plan, survey.walls, colours.truth, {width: 1, gaps: true});
    if (survey.said.length) {
      draw.rays(plan, core.transformPoints(pose, LIDAR.position), survey.points_w.filter((_, k) => k % 8 < 2), colours.clear);
      draw.dots(plan, survey.points_w, colours.hits, 1.6);
    }
    for (const leaf of Object.keys(LEAVES)) {
      draw.line(plan, LEAVES[leaf][open[leaf] ? "open" : "shut"], colours.highlight, {width: 2.5, dash: open[leaf] ? [3, 6] : []});
      draw.dots(plan, knob(leaf, open[leaf]), colours.highlight, 6);
    }
    world.robot(plan, pose, colours, "truth");
    const [x, y] = plan.at(SPEC.origin[0] + SPEC.resolution * cell[0], SPEC.origin[1] + SPEC.resolution * (cell[1] + 1)), side = SPEC.resolution * plan.scale;
    for (const [colour, width] of [[colours.free, 6], [colours.hits, 3]]) {
      Object.assign(plan.context, {strokeStyle: colour, lineWidth: width});
      plan.context.strokeRect(x - 2, y - 2, side + 4, side + 4);
    }
    const said = `${plural(survey.said.length, "scan")}, ${(100 * survey.worn).toFixed(0)} % of the seen walls worn off.`;
    plan.write(survey.full ? `${said} The survey is full: press <i>New map</i>.` : survey.driven ? said : `${said} Drag the robot.`);
  }

  /** A tug-of-war on the chosen cell: where the knot is, its log-odds are; the posts at the ends are the clamp. */
  function paintRope(rope, stage, survey, shown) {
    const {colours} = stage, {width, height, context} = rope, {clamp} = survey.settings, {level, diary} = survey, size = width < 500 ? 12 : 14;
    const x = value => width * (0.5 + (0.38 * value) / clamp), middle = height - 13, last = diary[diary.length - 1];
    if (level !== shown.to) Object.assign(shown, {from: shown.knot, to: level, share: stage.glide(0.4)});
    shown.knot = shown.from + shown.share() * (shown.to - shown.from);
    const bar = (from, to, colour, high) => {
      context.fillStyle = colour;
      context.fillRect(Math.min(from, to), middle - high / 2, Math.abs(to - from), high);
    };
    rope.clear(colours.free);
    bar(x(-clamp), x(clamp), colours.muted, 3);
    bar(x(0), x(shown.knot), shown.knot > 0 ? colours.hits : colours.clear, 9);
    for (const end of [clamp, -clamp]) bar(x(end) - 2, x(end) + 2, colours.highlight, 20);
    bar(x(0) - 1, x(0) + 1, colours.ink, 14);
    const pulls = last ? (last.hit ? 1 : -1) * (shown.knot === shown.to ? 0 : 10) : 0;
    draw.dots({context, at: (px, py) => [px, py]}, [x(shown.knot) + pulls, middle], colours.ink, 7);
    const words = (text, px, align, colour) => draw.text(rope, text, px, size + 1, colour, {size, align, halo: colours.free});
    const hits = diary.filter(page => page.hit).length;
    words(`◀ ${plural(diary.length - hits, "pass", "passes")}: free`, 8, "left", colours.ink);
    words(`${plural(hits, "hit")}: wall ▶`, width - 8, "right", colours.ink);
    if (Math.abs(level) > clamp - 1e-6) words("at the clamp", width / 2, "center", colours.ink);
  }

  /** The log-odds of the chosen cell over the scans, a mark at each scan that touched it, and the clamp. */
  function paintDiary(chart, colours, survey) {
    const {width, height, context} = chart, {clamp} = survey.settings, n = Math.max(survey.said.length, 20), size = width < 500 ? 12 : 14;
    const pages = survey.diary, most = Math.max(...pages.map(page => Math.abs(page.level)), 1), top = 1.6 * Math.min(clamp, Math.max(2, most));
    const left = 34, x = scan => left + ((width - left - 8) * scan) / n, y = level => height / 2 - (0.5 * height - 14) * (level / top);
    const line = (points, colour, wide, dash = []) => {
      Object.assign(context, {strokeStyle: colour, lineWidth: wide});
      context.setLineDash(dash);
      context.beginPath();
      points.forEach(point => context.lineTo(...point));
      context.stroke();
      context.setLineDash([]);
    };
    chart.clear(colours.sheet);
    line([[left, y(0)], [width, y(0)]], colours.muted, 1);
    for (const level of [clamp, -clamp]) line([[left, y(level)], [width, y(level)]], colours.highlight, 1.5, [5, 4]);
    const steps = [[x(0), y(0)]];
    let last = 0;
    for (const {scan, level} of pages) {
      steps.push([x(scan), y(last)], [x(scan), y(level)]);
      last = level;
    }
    line([...steps, [x(survey.said.length), y(last)]], colours.ink, 2);
    for (const {scan, hit, level} of pages) {
      context.fillStyle = hit ? colours.hits : colours.clear;
      context.fillRect(x(scan) - 2.5, y(level) - 2.5, 5, 5);
    }
    const write = (words, px, py, align) => draw.text(chart, words, px, py, colours.ink, {size, align, halo: colours.free});
    write("0", left - 5, y(0) + 4, "right");
    for (const level of [clamp, -clamp]) {
      if (y(level) > 0 && y(level) < height) write(level.toFixed(1), left - 5, y(level) + 4, "right");
    }
    write(`the log-odds of the chosen cell, in log 4: ${survey.level.toFixed(2)}`, left + 4, size, "left");
    write(`scan ${survey.said.length}`, width - 8, height - 5, "right");
  }

  /** The diary in words: the last scans that touched the cell. */
  function inWords(survey) {
    const pages = survey.diary, {clamp} = survey.settings;
    const lines = pages.slice(-LINES).map(({scan, hit, level}) =>
      `scan ${scan} ${hit ? dot("hits", "hit") : dot("clear", "passed")} ${signed(level)}${Math.abs(level) > clamp - 1e-6 ? " (clamp)" : ""}`);
    const start = `<b>Diary of cell (${survey.cell.join(", ")})</b>: ${tally(pages)}.`;
    return lines.length ? `${start} ${pages.length > LINES ? "… " : ""}${lines.join(" · ")}` : `${start} No scan has touched it: unknown.`;
  }

  const plural = (n, word, more = `${word}s`) => `${n} ${n === 1 ? word : more}`;

  /** How often beams have ended in the cell of a diary, and how often they passed through it. */
  function tally(pages) {
    const hits = pages.filter(page => page.hit).length;
    return `${plural(hits, "hit")}, ${plural(pages.length - hits, "pass", "passes")}`;
  }

  const signed = value => (value < 0 ? "−" : "+") + Math.abs(value).toFixed(2);

  function sentence(survey) {
    return `${plural(survey.said.length, "scan")}: ${survey.area.toFixed(1)} square metres free, ${(100 * survey.worn).toFixed(0)} percent of the ` +
      `well-seen wall cells worn off. Cell ${survey.cell.join(", ")}: ${tally(survey.diary)}, log-odds ` +
      `${survey.level.toFixed(2)} log 4.`;
  }
})(globalThis);
