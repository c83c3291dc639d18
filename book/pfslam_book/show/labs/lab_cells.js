/* Fifteen cells (chapter 03): a Bayes filter in a corridor, exact as a histogram and approximate with particles. */
(function (root) {
  "use strict";
  const {core, draw, lab} = root.pfslam;

  const CELLS = 15, DOORS = [1, 4, 10], START = 1;
  const STEP = [0.1, 0.8, 0.1];  // sent one cell on, the robot stays, moves one, or moves two, with these probabilities
  const WORDS = {start: "It has not looked yet", door: "It sees a door", wall: "It sees no door", move: "It moved one cell"};

  /** Belief after a move: each cell hands on its probability. The corridor runs round a courtyard. */
  function predictBelief(belief, step) {
    return belief.map((_, cell) => step.reduce((sum, p, moved) => sum + p * belief[(cell - moved + CELLS) % CELLS], 0));
  }

  /** Belief times the likelihood of what was seen, brought back to sum 1. */
  function updateBelief(belief, likelihood) {
    const product = belief.map((p, cell) => p * likelihood[cell]), sum = product.reduce((a, b) => a + b, 0);
    return sum > 0 ? product.map(p => p / sum) : belief;
  }

  /** How many cells a move goes for a random number in [0, 1). */
  const stepOf = u => (u < STEP[0] ? 0 : u < STEP[0] + STEP[1] ? 1 : 2);

  class Corridor {
    constructor(options) {
      this.settings = {particles: 30, atDoor: 0.8, atWall: 0.1, chance: false, dots: true, seed: 1, ...options};
      this.doors = new Set(DOORS);
      this.reset();
    }

    /** The robot wakes up and knows nothing; the particles stand as evenly in the corridor as they can, from a place of chance on. */
    reset() {
      const {particles: n, seed} = this.settings, filterDice = core.generator(seed + 1), first = filterDice.uniform();
      Object.assign(this, {
        worldDice: core.generator(seed), filterDice, truth: START, looks: 0, moves: 0,
        belief: new Float64Array(CELLS).fill(1 / CELLS), likelihood: null, what: "start", trace: [],
        cells: Int32Array.from({length: n}, (_, k) => Math.floor(((k + first) * CELLS) / n)), weights: new Float64Array(n).fill(1 / n), parents: null,
      });
      this.prior = this.belief;
    }

    /** One move: the belief blurs, and every particle makes a random step of its own. */
    move() {
      this.truth = (this.truth + (this.settings.chance ? stepOf(this.worldDice.uniform()) : 1)) % CELLS;
      const numbers = Array.from(this.cells, () => this.filterDice.uniform());
      this.note(numbers);
      Object.assign(this, {prior: this.belief, belief: predictBelief(this.belief, STEP), likelihood: null, what: "move"});
      this.cells = this.cells.map((cell, k) => (cell + stepOf(numbers[k])) % CELLS);
      this.moves += 1;
    }

    /** One look: the belief and each particle's weight are multiplied by the likelihood of what is seen. */
    look() {
      const {atDoor, atWall, chance} = this.settings, atTruth = this.doors.has(this.truth);
      const sees = chance ? this.worldDice.uniform() < (atTruth ? atDoor : atWall) : atTruth;
      this.likelihood = Float64Array.from({length: CELLS}, (_, cell) => {
        const door = this.doors.has(cell) ? atDoor : atWall;
        return sees ? door : 1 - door;
      });
      this.prior = this.belief;
      this.belief = updateBelief(this.belief, this.likelihood);
      this.weights = updateBelief(this.weights, Array.from(this.cells, cell => this.likelihood[cell]));
      this.what = sees ? "door" : "wall";
      this.looks += 1;
    }

    /** Draw the particles anew by their weights, each draw for itself, as the chapter's function does; then all weigh the same. */
    resample() {
      const numbers = Array.from(this.cells, () => this.filterDice.uniform()), {weights} = this, last = weights.length - 1;
      const drawn = u => { let k = 0; for (let sum = weights[0]; sum <= u && k < last; sum += weights[k]) k += 1; return k; };
      this.note(numbers);
      this.parents = numbers.map(drawn);
      this.cells = Int32Array.from(this.parents, from => this.cells[from]);
      this.weights = this.weights.map(() => 1 / this.weights.length);
    }

    toggle(cell) { if (!this.doors.delete(cell)) this.doors.add(cell); }

    /** The belief that the weighted particles stand for. */
    get histogram() {
      const sums = new Float64Array(CELLS);
      this.cells.forEach((cell, k) => { sums[cell] += this.weights[k]; });
      return sums;
    }

    /** For tests: all random numbers, in order. */
    note(numbers) { if (this.settings.trace) this.trace.push(numbers); }

    get best() { return this.belief.indexOf(Math.max(...this.belief)); }
  }

  lab("cells", stage => {
    const corridor = new Corridor(stage.options), tall = stage.body.clientWidth < 500 ? 18 : 11, floor = corridor.settings.dots ? 0 : 0.25 * tall;
    const shown = {cursor: 0, held: null, moved: false, before: null, share: () => 1};
    const plan = stage.plan({
      name: "The corridor with its doors, and under each cell its prior, its likelihood" + (corridor.settings.dots ? ", its posterior and its particles" : " and its posterior"),
      help: "Click or tap the corridor to make or remove a door, or drag a door. Keys: left and right choose a cell, " +
        "Enter makes or removes its door.",
      window: [-0.5, CELLS - 0.5, floor, tall],
    });
    const {settings} = corridor;
    if (settings.dots) stage.words(
      '<span class="pfslam-dot" aria-hidden="true" style="color:var(--lab-estimate)">●</span>\u00a0the belief, exact. ' +
      '<span class="pfslam-dot" aria-hidden="true" style="color:var(--lab-particles)">●</span>\u00a0<b>Each blue dot is a particle</b>, a guess; the ' +
      'larger, the heavier. The outlines are what the particles believe together.');
    /** What happens is seen as it happens: bars, dots and their sizes go from what they were to what they are. */
    const seen = (what, act) => () => {
      const {belief, cells, weights} = corridor;
      act();
      Object.assign(shown, {before: {what, belief, cells, weights}, share: stage.glide(what === "look" ? 0.9 : 0.6)});
    };
    stage.button({name: "Look", key: "l", press: seen("look", () => corridor.look())}).classList.add("pfslam-main");
    stage.button({name: "Move", key: "m", press: seen("move", () => corridor.move())}).classList.add("pfslam-main");
    if (settings.dots) stage.button({name: "Resample", key: "r", press: seen("resample", () => corridor.resample())});
    const forget = () => { shown.before = null; corridor.reset(); };
    if (!settings.dots) stage.button({name: "Start again", key: "n", press: forget});
    stage.fold("More");
    if (settings.dots) stage.button({name: "Start again", key: "n", press: forget});
    stage.slider({name: "Right at a door", min: 0, max: 1, step: 0.01, value: settings.atDoor,
                  change: value => { settings.atDoor = value; }});
    stage.slider({name: "Right at a wall", min: 0, max: 1, step: 0.01, value: 1 - settings.atWall,
                  change: value => { settings.atWall = 1 - value; }});
    stage.button({name: "New dice", key: "d", press: () => { settings.seed += 1; forget(); }});
    stage.check({name: "The robot slips and errs", key: "c", change: value => { settings.chance = value; }});
    if (settings.dots) stage.slider({name: "Particles", min: 5, max: 200, step: 1, value: settings.particles, digits: 0,
                  change: value => { settings.particles = value; forget(); }});

    const cellAt = x => Math.max(0, Math.min(CELLS - 1, Math.round(x)));
    stage.drag(plan, {
      start: (x, y) => { Object.assign(shown, {held: y > 0.88 * tall ? cellAt(x) : null, moved: false, cursor: cellAt(x)}); },
      move: x => {
        const {held} = shown, cell = cellAt(x);
        if (held === null || cell === held || !corridor.doors.has(held) || corridor.doors.has(cell)) return;
        corridor.toggle(held);
        corridor.toggle(cell);
        Object.assign(shown, {held: cell, cursor: cell, moved: true});
      },
      end: cancelled => { if (shown.held !== null && !shown.moved && !cancelled) corridor.toggle(shown.held); },
    });
    const turn = by => down => { if (down) shown.cursor = (shown.cursor + by + CELLS) % CELLS; };
    stage.keys(plan, {ArrowLeft: turn(-1), ArrowRight: turn(1), Enter: down => { if (down) corridor.toggle(shown.cursor); }});
    return {state: corridor, shown, draw: () => paint(plan, stage.colours, corridor, shown, tall), describe: () => sentence(corridor)};
  });

  function paint(plan, colours, corridor, shown, tall) {
    const {prior, likelihood, what} = corridor, part = share => share * tall;
    const {before} = shown, share = before ? shown.share() : 1, between = (from, to) => from + share * (to - from);
    const belief = corridor.belief.map((value, cell) => (before ? between(before.belief[cell], value) : value));
    const looked = likelihood !== null, size = plan.width < 500 ? 12 : 14;
    plan.clear(colours.free);
    paintCorridor(plan, colours, corridor, shown, part(0.9));
    const rows = [
      [0.72, 0.13, prior, colours.muted, looked ? "prior: the belief before" : "the belief before"],
      [0.555, 0.115, looked ? likelihood : [], colours.highlight,
       looked ? `× likelihood: ${WORDS[what].toLowerCase()}` : WORDS[what].toLowerCase()],
      [0.27, 0.22, belief, colours.estimate,
       looked ? "= posterior, made to sum to 1" : what === "start" ? "all cells alike" : "the belief after the move"],
    ];
    for (const [bottom, height, values, colour, words] of rows) {
      draw.line(plan, [-0.5, part(bottom), CELLS - 0.5, part(bottom)], colours.muted, {width: 1});
      values.forEach((value, cell) => box(plan, cell, part(bottom), part(height) * value, colour));
      const [, y] = plan.at(0, part(bottom + height));
      draw.text(plan, words, 8, y - 3, colours.ink, {size});
    }
    if (share < 1 && before.what === "look") shine(plan, colours, corridor, 4 * share * (1 - share), part);
    if (!corridor.settings.dots) return;
    if (share === 1) {
      const [bottom, height] = rows[2];
      corridor.histogram.forEach((value, cell) => box(plan, cell, part(bottom), part(height) * value, null, colours.ink));
    }
    paintParticles(plan, colours, corridor, before, share, part(0.25));
  }

  /** The corridor from above: a cell each, orange where there is a door, and the robot. */
  function paintCorridor(plan, colours, corridor, shown, bottom) {
    const top = plan.window[3], middle = (bottom + top) / 2;
    for (let cell = 0; cell < CELLS; cell++) {
      box(plan, cell, bottom, top - bottom - 0.08, corridor.doors.has(cell) ? colours.highlight : colours.paper, null, 0.96);
      const [x, y] = plan.at(cell, bottom);
      draw.text(plan, String(cell), x, y - 4, corridor.doors.has(cell) ? "#1b1b1b" : colours.ink, {size: 12, align: "center"});
    }
    if (document.activeElement === plan.holder) box(plan, shown.cursor, bottom, top - bottom - 0.08, null, colours.ink, 0.9, 3);
    draw.robot(plan, [corridor.truth, middle + 0.1, 0], corridor.doors.has(corridor.truth) ? "#1b1b1b" : colours.truth, {radius: 0.24});
  }

  /** What was seen shines down on the bars of the belief, each cell as brightly as its likelihood. */
  function shine(plan, colours, {likelihood}, bright, part) {
    likelihood.forEach((value, cell) => {
      plan.context.globalAlpha = 0.55 * bright * value;
      box(plan, cell, part(0.27), part(0.285), colours.highlight);
    });
    plan.context.globalAlpha = 1;
  }

  /** Places and radii (m, pixels) of particles that hang down from `top`, side by side where there are many in a cell;
   * their areas are their weights. */
  function hang(plan, {cells, weights}, top) {
    const n = cells.length, most = Math.max(...Array.from({length: CELLS}, (_, c) => cells.filter(cell => cell === c).length));
    const below = wide => Math.min(0.62, (top - 0.3) / Math.ceil(most / wide)), enough = [1, 2, 3, 4, 5].find(wide => below(wide) >= 0.9 / wide);
    const wide = enough || 6, apart = below(wide), counts = new Int32Array(CELLS), average = plan.scale * Math.min(0.24, 0.42 / wide);
    return {
      places: Array.from(cells, cell => {
        const k = counts[cell]++;
        return [cell + ((k % wide) - (wide - 1) / 2) * (0.9 / wide), top - 0.4 - apart * Math.floor(k / wide)];
      }),
      radii: Array.from(weights, weight => Math.min(0.45 * plan.scale, Math.max(0.7, average * Math.sqrt(n * weight)))),
    };
  }

  /** The particles. After a resampling each begins where its parent was, so that heavy dots split and light ones vanish. */
  function paintParticles(plan, colours, corridor, before, share, top) {
    const now = hang(plan, corridor, top), old = before && share < 1 ? hang(plan, before, top) : now, {parents} = corridor;
    const from = k => (old !== now && before.what === "resample" ? parents[k] : k), between = (a, b) => a + share * (b - a);
    const places = now.places.flatMap(([x, y], k) => {
      const [x0, y0] = old.places[from(k)];
      return [between(x0 - x > CELLS / 2 ? x0 - CELLS : x0, x), between(y0, y)];  // out at one end, in at the other
    });
    if (old !== now && before.what === "resample") {
      const childless = old.places.map((_, k) => k).filter(k => !parents.includes(k));
      draw.dots(plan, childless.flatMap(k => old.places[k]), colours.muted, childless.map(k => (1 - share) * old.radii[k]));
    }
    draw.dots(plan, places, colours.particles, now.radii.map((radius, k) => between(old.radii[from(k)], radius)));
    Object.assign(plan.context, {strokeStyle: colours.estimate, lineWidth: 1});
    plan.context.stroke();
  }

  /** A bar or a frame on a cell. */
  function box(plan, cell, bottom, height, fill, frame = null, wide = 0.8, width = 1.4) {
    const [x, y] = plan.at(cell - wide / 2, bottom + height), size = [wide * plan.scale, height * plan.scale];
    if (fill) { plan.context.fillStyle = fill; plan.context.fillRect(x, y, ...size); }
    if (frame) { Object.assign(plan.context, {strokeStyle: frame, lineWidth: width}); plan.context.strokeRect(x, y, ...size); }
  }

  function sentence(corridor) {
    const {belief, best, truth, weights, histogram, what, doors} = corridor;
    const dots = corridor.settings.dots ? ` The particles give that cell ${histogram[truth].toFixed(2)}; ` +
      `${core.effectiveSampleSize(weights).toFixed(1)} of ${weights.length} count.` : "";
    return `${WORDS[what]}. The most probable cell is ${best} with ${belief[best].toFixed(2)}; the robot is in cell ${truth}, which ` +
      `has ${belief[truth].toFixed(2)}.${dots} Doors: ${[...doors].sort((a, b) => a - b).join(", ") || "none"}.`;
  }
})(globalThis);
