/* A map for each particle (chapter 05, act three): SLAM in fifteen cells whose doors nobody knows beforehand. */
(function (root) {
  "use strict";
  const {core, draw, lab} = root.pfslam;

  const CELLS = 15, DOORS = [1, 4, 10], PRIOR = 0.3;  // cell 0 is the entrance
  const AT_DOOR = 0.95, AT_WALL = 0.05, ENTRANCE = 0.98;  // chances of seeing a door, and of telling the entrance
  const STEP = [0.05, 0.9, 0.05];  // sent one cell on, it stays, moves one, or moves two
  const OPENING = 12, REMEMBERED = 60;  // steps before the reader comes: nothing has died yet; cells of a path that are kept
  const MARGIN = 2.4;  // the room at the left for the lines from parents to children, in cells

  const dot = (name, words = "") => `<span${words && ` data-layer="${name}"`}><span class="pfslam-dot" aria-hidden="true" ` +
    `style="color:var(--lab-${name});outline:1px solid var(--lab-muted)">●</span>${words}</span>`;

  const stepOf = u => (u < STEP[0] ? 0 : u < STEP[0] + STEP[1] ? 1 : 2);

  /** The walk of the robot, and particles that are a cell, a map of fifteen doors and a path each. */
  class Walk {
    constructor(options) {
      this.settings = {particles: 40, shared: false, seed: 38, ...options};
      this.doors = new Set(DOORS);
      this.reset();
    }

    /** All stand at the entrance, and all maps are blank. */
    reset() {
      const {particles: n, seed} = this.settings, blank = Float64Array.from({length: CELLS}, (_, c) => (c ? PRIOR : 0));
      Object.assign(this, {
        worldDice: core.generator(2 * seed), filterDice: core.generator(2 * seed + 1), truth: 0, way: 0, moves: 0, looks: 0,
        what: "start", sees: false, trace: [], cells: new Int32Array(n), weights: new Float64Array(n).fill(1 / n),
        maps: Array.from({length: n}, () => blank), paths: Array.from({length: n}, () => [0]), family: null,
        founders: Int32Array.from({length: n}, (_, k) => k), lookedAt: -1,
      });
      this.chosen = Math.min(this.chosen || 0, n - 1);
    }

    get n() { return this.cells.length; }
    get round() { return 1 + Math.floor(this.way / CELLS); }
    get nEff() { return core.effectiveSampleSize(this.weights); }

    /** The robot goes on, and every particle makes a random step of its own. */
    move() {
      const u = this.worldDice.uniform(), numbers = Array.from(this.cells, () => this.filterDice.uniform()), before = this.round;
      this.way += stepOf(u);
      this.truth = this.way % CELLS;
      this.cells = this.cells.map((cell, k) => (cell + stepOf(numbers[k])) % CELLS);
      this.paths = this.paths.map((path, k) => [...path.slice(1 - REMEMBERED), this.cells[k]]);
      if (this.round > before) this.founders = this.founders.map((_, k) => k);  // a new round: count histories afresh
      this.moves += 1;
      this.what = "move";
      this.note({truth: this.truth, numbers});
    }

    /** One look: every particle is weighed in its own map from its own cell, and draws what was seen into that cell. */
    look() {
      const {shared} = this.settings, {doors, truth} = this;
      const sees = this.worldDice.uniform() < (doors.has(truth) ? AT_DOOR : AT_WALL);
      const looks = Array.from(this.cells, (cell, k) => core.doorAfter(this.maps[k][cell], sees, AT_DOOR, AT_WALL));
      const joint = this.weights.map((weight, k) =>
        weight * looks[k].likelihood * ((this.cells[k] === 0) === (truth === 0) ? ENTRANCE : 1 - ENTRANCE));
      const sum = joint.reduce((a, b) => a + b, 0);
      this.weights = joint.map(weight => weight / sum);
      const best = this.weights.indexOf(Math.max(...this.weights));
      this.maps = this.maps.map((map, k) => {
        const from = shared ? best : k, cell = this.cells[from];
        return map.map((door, c) => (c !== cell ? door : cell === 0 ? 0 : looks[from].door));
      });
      Object.assign(this, {sees, what: truth ? (sees ? "door" : "wall") : "entrance", lookedAt: this.moves});
      this.looks += 1;
      this.note({sees, truth, shared});
    }

    /** Draw the particles anew by their weights; each copy takes its map and its path along. */
    resample() {
      const u = this.filterDice.uniform(), ancestors = core.systematicResample(this.weights, u), {n} = this;
      const pick = values => Array.from(ancestors, from => values[from]);
      this.family = {ancestors, weights: this.weights, maps: this.maps, cells: this.cells};
      Object.assign(this, {cells: Int32Array.from(pick(this.cells)), maps: pick(this.maps), paths: pick(this.paths),
                           founders: Int32Array.from(pick(this.founders)), weights: new Float64Array(n).fill(1 / n), what: "resample"});
      this.note({u});
    }

    /** A whole step: resample if few particles carry the weight, move, look. */
    step() {
      if (this.looks && this.nEff < this.n / 2) this.resample();
      if (this.looks) this.move();
      this.look();
    }

    /** For tests: what happened, in order, with all random numbers. */
    note(event) { if (this.settings.trace) this.trace.push(event); }

    toggle(cell) { if (cell && !this.doors.delete(cell)) this.doors.add(cell); }

    /** The map on which the weighted particles agree. */
    get together() {
      return Float64Array.from({length: CELLS}, (_, c) => this.maps.reduce((sum, map, k) => sum + this.weights[k] * map[c], 0));
    }

    /** How much weight stands in each cell. */
    get belief() {
      const sums = new Float64Array(CELLS);
      this.cells.forEach((cell, k) => { sums[cell] += this.weights[k]; });
      return sums;
    }

    /** How many of the histories with which this round began are left. */
    get histories() { return new Set(this.founders).size; }

    /** How many cells the common map has right. */
    get right() { return this.together.filter((door, c) => door > 0.5 === this.doors.has(c)).length; }
  }

  lab("maps", stage => {
    const walk = new Walk(stage.options);
    for (let k = 0; k < OPENING && !stage.options.empty; k++) walk.step();  // it is under way when the reader comes
    const narrow = stage.body.clientWidth < 500, rows = narrow ? 10 : 8;
    const tall = rows + (narrow ? 7 : 5), shown = {cursor: 1, moved: false, family: null, share: () => 1};
    const plan = stage.plan({
      name: "The corridor, the map on which the particles agree, and below it each particle's own map",
      help: "Click or tap a row to follow its particle, or a cell of the corridor to make or wall up a door. Keys: up and " +
        "down choose a particle, left and right a cell, Enter makes or walls up its door.",
      window: [-0.5 - MARGIN, CELLS - 0.5, 0, tall],
    });
    const place = layout(tall, rows, narrow);
    stage.words(
      `<b>Each row is one particle</b> and its own map: ${dot("wall", " a door,")} ${dot("free")} no door, ${dot("paper")} not ` +
      `seen yet. ${dot("particles", " where it believes it is;")} the larger, the heavier. The lines at the left ` +
      "lead from each row to the particle of which it is a copy.");
    const story = stage.words("");
    const clock = stage.clock({hertz: 2, tick: () => walk.step(), step: () => walk.step()});
    const byHand = action => () => { clock.pause(); action(); };
    stage.button({name: "Start again", key: "n", press: () => walk.reset()});
    stage.fold("More");
    stage.button({name: "Look", key: "l", press: byHand(() => walk.look())});
    stage.button({name: "Resample", key: "r", press: byHand(() => walk.resample())});
    stage.button({name: "Move", key: "m", press: byHand(() => walk.move())});
    stage.check({name: "One shared map", key: "o", change: value => { walk.settings.shared = value; walk.reset(); }});
    stage.button({name: "New dice", key: "d", press: () => { walk.settings.seed += 1; walk.reset(); }});
    stage.slider({name: "Particles", min: 8, max: 100, step: 1, value: walk.settings.particles, digits: 0,
                  change: value => { walk.settings.particles = value; walk.reset(); }});

    const cellAt = x => Math.max(0, Math.min(CELLS - 1, Math.round(x)));
    const rowAt = y => Math.max(0, Math.min(walk.n - 1, Math.floor(((place.rows - y) / place.rows) * walk.n)));
    let strip = false;
    stage.drag(plan, {
      start: (x, y) => {
        strip = y > place.strip;
        if (strip) shown.cursor = cellAt(x);
        else if (y < place.rows) walk.chosen = rowAt(y);
      },
      move: (x, y) => { if (!strip && y < place.rows) walk.chosen = rowAt(y); },
      end: cancelled => { if (strip && !cancelled) walk.toggle(shown.cursor); },
    });
    const choose = by => down => { if (down) walk.chosen = (walk.chosen + by + walk.n) % walk.n; };
    const turn = by => down => { if (down) shown.cursor = (shown.cursor + by + CELLS) % CELLS; };
    stage.keys(plan, {ArrowUp: choose(-1), ArrowDown: choose(1), ArrowLeft: turn(-1), ArrowRight: turn(1),
                      Enter: down => { if (down) walk.toggle(shown.cursor); }});
    return {
      state: walk, shown,
      draw() {
        if (walk.family !== shown.family) Object.assign(shown, {family: walk.family, share: stage.glide(0.45)});
        paint(plan, stage.colours, walk, shown, place);
        story.innerHTML = path(walk);
      },
      describe: () => sentence(walk),
    };
  });

  /** The heights of the parts, from the top: the corridor, the common map, the belief, the rows. */
  function layout(tall, rows, narrow) {
    const gap = narrow ? 1 : 0.6;
    const strip = tall - (narrow ? 1.6 : 1.1);
    return {top: tall, strip, common: strip - gap - 0.8, belief: rows + gap + 0.15, rows, gap};
  }

  function paint(plan, colours, walk, shown, place) {
    const size = plan.width < 500 ? 12 : 14, shade = shades(colours), belief = walk.belief, room = place.common - place.gap - place.belief;
    const label = (words, y) => draw.text(plan, words, plan.at(-0.5, 0)[0], plan.at(0, y)[1] - 4, colours.ink, {size});
    plan.clear(colours.paper);
    paintCorridor(plan, colours, walk, shown, place);
    walk.together.forEach((door, cell) => box(plan, cell, place.common, 0.8, shade(door), 0.96));
    label("the map on which they agree", place.common + 0.8);
    draw.line(plan, [-0.5, place.belief, CELLS - 0.5, place.belief], colours.muted, {width: 1});
    belief.forEach((value, cell) => box(plan, cell, place.belief, value * room, colours.estimate, 0.8));
    label("where they believe they are", place.belief + room);
    label("the particles", place.rows);
    if (walk.what !== "start") {
      draw.text(plan, WORDS[walk.what], plan.width - 6, plan.at(0, place.rows)[1] - 4, colours.ink, {size, align: "right"});
    }
    paintRows(plan, colours, walk, place, shade, walk.family ? shown.share() : 1);
    paintFamily(plan, colours, walk, place);
  }

  /** The corridor as it is: orange where there is a door, and the robot. */
  function paintCorridor(plan, colours, walk, shown, place) {
    const height = place.top - place.strip - 0.08;
    for (let cell = 0; cell < CELLS; cell++) {
      const door = walk.doors.has(cell);
      box(plan, cell, place.strip, height, door ? colours.highlight : colours.free, 0.96);
      const [x, y] = plan.at(cell, place.strip), few = plan.width < 500 && cell % 5 && !door && cell !== shown.cursor;
      if (!few) draw.text(plan, String(cell), x, y - 3, door ? "#1b1b1b" : colours.ink, {size: plan.width < 500 ? 11 : 12, align: "center"});
    }
    if (document.activeElement === plan.holder) frame(plan, shown.cursor, place.strip, height, colours.ink, 3);
    const [x, y] = plan.at(-0.5 - MARGIN, place.strip + 0.4);
    draw.text(plan, plan.width < 500 ? "truth" : "the truth", x + 6, y, colours.ink, {size: plan.width < 500 ? 12 : 14});
    draw.robot(plan, [walk.truth, place.top - 0.42, 0], walk.doors.has(walk.truth) ? "#1b1b1b" : colours.truth, {radius: 0.24});
  }

  /** A map and a dot for each particle. After a resampling the rows come from where their parents were, and histories
   * that have died fade. */
  function paintRows(plan, colours, walk, place, shade, share) {
    const {n, cells, weights, maps, family} = walk, high = place.rows / n, places = new Float64Array(2 * n);
    const average = 0.42 * Math.min(high, 0.9) * plan.scale;
    const row = (map, k) => {
      for (let c = 0; c < CELLS; c++) box(plan, c, place.rows - (k + 1) * high, 0.9 * high, shade(map[c]), 0.96);
    };
    if (share < 1) {
      plan.context.globalAlpha = 1 - share;
      family.maps.forEach((map, k) => { if (!family.ancestors.includes(k)) row(map, k); });
      plan.context.globalAlpha = 1;
    }
    maps.forEach((map, k) => {
      const at = share < 1 ? family.ancestors[k] + share * (k - family.ancestors[k]) : k;
      row(map, at);
      places.set([cells[k], place.rows - (at + 0.55) * high], 2 * k);
    });
    const radii = weights.map(weight => Math.max(0.5, Math.min(0.48 * plan.scale, average * Math.sqrt(n * weight))));
    draw.dots(plan, places, colours.particles, radii);
    Object.assign(plan.context, {strokeStyle: colours.estimate, lineWidth: 1});
    plan.context.stroke();
    const [x, y] = plan.at(-0.5, place.rows - walk.chosen * high);
    Object.assign(plan.context, {strokeStyle: colours.highlight, lineWidth: 2.5});
    plan.context.strokeRect(x, y, CELLS * plan.scale - 1, high * plan.scale);
  }

  /** Lines from the particles before the last resampling, at the left, to their copies; the dots are their weights. */
  function paintFamily(plan, colours, {family, n}, place) {
    if (!family) return;
    const high = place.rows / n, left = -0.1 - MARGIN, y = k => place.rows - (k + 0.55) * high, lines = [], places = [];
    family.ancestors.forEach((from, to) => lines.push(left, y(from), -0.6, y(to)));
    family.weights.forEach((_, k) => places.push(left, y(k)));
    draw.line(plan, lines, colours.estimate, {width: 1, gaps: true});
    const average = 0.42 * Math.min(high, 0.9) * plan.scale;
    family.weights.forEach((weight, k) => {  // those who have no children stay behind, pale
      plan.context.globalAlpha = family.ancestors.includes(k) ? 1 : 0.35;
      draw.dots(plan, places.slice(2 * k, 2 * k + 2), colours.particles, Math.max(0.5, Math.min(0.35 * plan.scale, average * Math.sqrt(n * weight))));
    });
    plan.context.globalAlpha = 1;
  }

  /** A door's probability as a grey: unknown as paper, a wall light, a door dark. */
  function shades(colours) {
    const [paper, wall, door] = [colours.paper, colours.free, colours.wall].map(hex => [1, 3, 5].map(k => parseInt(hex.slice(k, k + 2), 16)));
    return p => {
      const part = p > PRIOR ? (p - PRIOR) / (1 - PRIOR) : 1 - p / PRIOR, towards = p > PRIOR ? door : wall;
      return `rgb(${paper.map((from, c) => Math.round(from + part * (towards[c] - from))).join(",")})`;
    };
  }

  function box(plan, cell, bottom, height, fill, wide) {
    const [x, y] = plan.at(cell - wide / 2, bottom + height);
    plan.context.fillStyle = fill;
    plan.context.fillRect(x, y, wide * plan.scale, height * plan.scale);
  }

  function frame(plan, cell, bottom, height, colour, width) {
    const [x, y] = plan.at(cell - 0.45, bottom + height);
    Object.assign(plan.context, {strokeStyle: colour, lineWidth: width});
    plan.context.strokeRect(x, y, 0.9 * plan.scale, height * plan.scale);
  }

  /** The chosen particle in words: its weight, its doors and its path. */
  function path({chosen, weights, maps, paths, n}) {
    const doors = Array.from(maps[chosen].keys()).filter(c => maps[chosen][c] > 0.5), way = paths[chosen].slice(-24);
    return `<b>Particle ${chosen + 1}</b> has ${(weights[chosen] * n).toFixed(2)} times the average weight, draws ` +
      `${doors.length ? `doors at ${doors.join(", ")}` : "no door yet"}, and has come ` +
      `${paths[chosen].length > way.length ? "… " : ""}${way.join(" ")}.`;
  }

  const WORDS = {start: "All stand at the entrance and know of no door", move: "They moved", resample: "Resampled",
                 door: "The robot sees a door", wall: "The robot sees no door", entrance: "The robot is at the entrance"};

  function sentence(walk) {
    const {what, moves, round, truth, belief, n, histories, right, nEff} = walk;
    return `${WORDS[what]}. After ${moves} moves, in round ${round}, ${belief[truth].toFixed(2)} of the weight is in the robot's ` +
      `cell ${truth}. ${nEff.toFixed(0)} of ${n} particles count. Histories left since this round began: ${histories}. Cells that ` +
      `their common map has right: ${right} of ${CELLS}.`;
  }
})(globalThis);
