/* Slide the scan (chapter 04): drag and turn a scan over the map; its score and the scores of all shifts follow.
 * The scan is cast wherever the reader stands in the building. */
(function (root) {
  "use strict";
  const {core, draw, lab, world} = root.pfslam, {WINDOW, SPEC, LIDAR, dot} = world;

  const REACH = 2.4, SHIFT = 0.05, SHIFTS = 8;  // m to each side of the robot; m from one shift to the next, so many each way
  const LIMIT = SHIFT * SHIFTS, TURN = 10, HANDLE = 0.8;  // m and degrees that the guess may be moved; m from robot to handle
  const FULL = {occupied: 1, distance: 1000};  // what a point scores at most
  const RADIANS = Math.PI / 180;
  const STRIDE = 0.1, CLICK = 5;  // m and degrees for a key, when the reader walks
  // Where the robot is, and how far off (m, m, rad) the guess begins.
  const PLACES = {corner: {pose: [6.9, 1.2, 0.3], off: [-0.1, 0.1, -2 * RADIANS]}, corridor: {pose: [4.5, 3, 0], off: [0, 0, 0]},
                  anywhere: {pose: [2.1, 4.8, 0], off: [0, 0, 0]}};

  /** The map of the building, a scan in it, and the guess of where the scan was taken. */
  class Guess {
    constructor() {
      Object.assign(this, {spec: SPEC, cells: world.known().occupied, kind: "occupied", fields: {}, here: PLACES.anywhere.pose});
      this.stand("corner");
    }

    /** Stand at x, y (m), facing theta (rad), and take a scan there. */
    walk(x, y, theta) {
      if (!world.room([x, y])) return;
      this.here = [x, y, theta];
      this.stand("anywhere");
    }

    /** Go to a place, and take its scan; the guess starts as far off as it is there. */
    stand(place) {
      const pose = place === "anywhere" ? this.here : PLACES[place].pose, {off} = PLACES[place];
      const points_b = core.scanPoints(world.scan(pose, core.generator(1)), LIDAR);
      Object.assign(this, {place, pose_w: pose, start: pose.map((value, k) => value + off[k]), shift: [0, 0], turn: 0, points_b});
    }

    get field() { return (this.fields[this.kind] = this.fields[this.kind] || core.scoreField(this.cells, this.spec, this.kind)); }

    get pose() {
      const [x, y, theta] = this.start;
      return [x + this.shift[0], y + this.shift[1], theta + this.turn * RADIANS];
    }

    /** Move the guess to a shift (m) from where it started, as far as is allowed. */
    slide(dx, dy) { this.shift = [dx, dy].map(value => Math.max(-LIMIT, Math.min(LIMIT, value))); }

    /** The share of the best possible score at each of these poses. Eq. 6 to 9. */
    shares(poses) {
      const full = (FULL[this.kind] * this.points_b.length) / 2;
      return core.scores(this.field, this.spec, this.points_b, poses).map(score => score / full);
    }

    get share() { return this.shares(Float64Array.from(this.pose))[0]; }

    /** The shares of all shifts at the present heading, row by row from the lowest; kept until heading, scan or field change. */
    surface() {
      const key = [this.start, this.points_b, this.turn, this.kind];
      if (!this.scored || key.some((value, k) => value !== this.scored.key[k])) this.scored = {key, surface: this.allShifts()};
      return this.scored.surface;
    }

    allShifts() {
      const poses = [], [x, y] = this.start, theta = this.pose[2];
      for (let j = -SHIFTS; j <= SHIFTS; j++) {
        for (let i = -SHIFTS; i <= SHIFTS; i++) poses.push(x + SHIFT * i, y + SHIFT * j, theta);
      }
      return this.shares(Float64Array.from(poses));
    }
  }

  lab("slide", stage => {
    const guess = new Guess();
    const plan = stage.plan({
      name: "The map and the scan as it lies from the guessed pose",
      help: "Drag the robot, and the scan slides with it; turn it by the dot before the robot. Keys: arrows slide it by a centimetre, the " +
        "letters Q and E turn it.",
      window: world.near(guess.start, REACH),
    });
    stage.words([dot("hits", "points of the scan beside walls,"), dot("highlight", "on walls. In the corner: the scores of all shifts.")].join(" "));
    const turned = value => { guess.turn = value; };
    const go = () => { plan.window = world.near(guess.start, REACH); turn.value = 0; turn.dispatchEvent(new Event("input")); };
    const where = stage.choice({name: "Place", options: Object.fromEntries(Object.keys(PLACES).map(name => [name, name])),
                  value: guess.place, change: name => { guess.stand(name); go(); }});
    stage.choice({name: "Score by", options: {occupied: "count of points on walls", distance: "likelihood field"}, value: guess.kind,
                  change: kind => { guess.kind = kind; }});
    stage.button({name: "Start again", key: "n", press: () => { guess.stand(guess.place); go(); }});
    stage.fold("Stand anywhere in the building");
    const turn = stage.slider({name: "Turn", min: -TURN, max: TURN, step: 0.1, value: 0, unit: "°", digits: 1, change: turned});
    let held = null, before = null;
    const onHandle = (x, y) => plan.near(x, y, handle(guess.pose));
    stage.drag(plan, {
      start: (x, y) => {
        before = [...guess.shift, turn.value];
        held = onHandle(x, y) ? "handle" : [x - guess.shift[0], y - guess.shift[1]];
      },
      move: (x, y) => {
        if (held !== "handle") { guess.slide(x - held[0], y - held[1]); return; }
        const [px, py] = guess.pose, turned = core.wrapAngle(Math.atan2(y - py, x - px) - guess.start[2]) / RADIANS;
        turn.value = Math.max(-TURN, Math.min(TURN, turned));
        turn.dispatchEvent(new Event("input"));
      },
      end: cancelled => {
        if (!cancelled) return;
        guess.slide(before[0], before[1]);
        turn.value = before[2];
        turn.dispatchEvent(new Event("input"));
      },
      grab: (x, y) => onHandle(x, y) || plan.near(x, y, guess.pose),
    });
    const by = (dx, dy) => down => { if (down) guess.slide(guess.shift[0] + dx, guess.shift[1] + dy); };
    const spin = by_ => down => {
      if (!down) return;
      turn.value = Number(turn.value) + by_;
      turn.dispatchEvent(new Event("input"));
    };
    stage.keys(plan, {ArrowLeft: by(-0.01, 0), ArrowRight: by(0.01, 0), ArrowUp: by(0, 0.01), ArrowDown: by(0, -0.01),
                      q: spin(0.5), e: spin(-0.5)});
    /** From now on the scan is one of the reader's own place. */
    function walk(x, y, theta) {
      guess.walk(x, y, theta);
      where.querySelector("[value=anywhere]").checked = true;
      go();
    }
    const facing = stage.slider({
      name: "Stand facing", min: -180, max: 180, step: 1, value: guess.here[2] / RADIANS, unit: "°", digits: 0,
      change: value => walk(guess.here[0], guess.here[1], value * RADIANS),
    });
    const overview = stroll(stage, guess, walk, facing);
    return {
      state: guess, constants: {SPEC, LIDAR, occupied: guess.cells},
      draw() {
        paintMap(plan, stage.colours, guess);
        paintScores(plan, stage.colours, guess);
        paintBuilding(overview, stage.colours, guess);
      },
      describe: () => sentence(guess),
    };
  });

  /** A plan of the whole building in which the reader stands anywhere. */
  function stroll(stage, guess, walk, facing) {
    const overview = stage.plan({
      name: "The whole building, and where the robot stands",
      help: "Click, tap or drag in the building to stand there. Keys: arrows walk, the letters Q and E turn.",
      window: WINDOW,
    });
    const goTo = (x, y) => walk(x, y, guess.here[2]);
    stage.drag(overview, {start: goTo, move: goTo, grab: (x, y) => overview.near(x, y, guess.here)});
    const by = (dx, dy) => down => { if (down) goTo(guess.here[0] + dx * STRIDE, guess.here[1] + dy * STRIDE); };
    const spin = degrees => down => {
      if (!down) return;
      facing.value = core.wrapAngle((Number(facing.value) + degrees) * RADIANS) / RADIANS;
      facing.dispatchEvent(new Event("input"));
    };
    stage.keys(overview, {ArrowLeft: by(-1, 0), ArrowRight: by(1, 0), ArrowUp: by(0, 1), ArrowDown: by(0, -1),
                          q: spin(CLICK), e: spin(-CLICK)});
    return overview;
  }

  /** The building, a frame for the piece of it above, and the robot with its scan. */
  function paintBuilding(plan, colours, guess) {
    const {start, pose_w} = guess, [left, right, low, high] = world.near(start, REACH), [x, y] = plan.at(left, high);
    world.paint(plan, colours);
    Object.assign(plan.context, {strokeStyle: colours.highlight, lineWidth: 2});
    plan.context.strokeRect(x, y, (right - left) * plan.scale, (high - low) * plan.scale);
    squares(plan, core.transformPoints(pose_w, guess.points_b), colours.hits, 1);
    world.robot(plan, pose_w, colours, "truth");
  }

  function paintMap(plan, colours, guess) {
    const {pose, points_b, cells} = guess, points_w = core.transformPoints(pose, points_b), on = [], off = [];
    plan.clear(colours.paper);
    draw.grid(plan, world.known().grid, colours, 1);
    const places = core.worldToCell(SPEC, points_w);
    for (let k = 0; k < points_w.length; k += 2) {
      const hit = core.contains(SPEC, places[k], places[k + 1]) && cells[places[k + 1] * SPEC.shape[1] + places[k]];
      (hit ? on : off).push(points_w[k], points_w[k + 1]);
    }
    squares(plan, off, colours.hits, 2);
    squares(plan, on, colours.highlight, 2.8);
    paintHandle(plan, colours, pose, guess.share / Math.max(...guess.surface()));
    world.robot(plan, pose, colours, "estimate");
    plan.write(`${(100 * guess.share).toFixed(0)} % of the best possible score`);
  }

  /** The handle on its line, and a glow round the robot that grows as the scan nears the best shift. */
  function paintHandle(plan, colours, pose, share) {
    const {context} = plan, [x, y] = plan.at(pose[0], pose[1]), near = Math.max(0, 5 * share - 4);
    const glow = context.createRadialGradient(x, y, 0, x, y, 70);
    glow.addColorStop(0, colours.highlight);
    glow.addColorStop(1, `${colours.highlight}00`);
    Object.assign(context, {fillStyle: glow, globalAlpha: 0.7 * near});
    context.fillRect(x - 70, y - 70, 140, 140);
    context.globalAlpha = 1;
    draw.line(plan, [...pose.slice(0, 2), ...handle(pose)], colours.estimate, {width: 1.5, dash: [4, 4]});
    draw.knob(plan, handle(pose), colours);
  }

  /** The dot before the robot by which the scan is turned. */
  function handle([x, y, theta]) { return [x + HANDLE * Math.cos(theta), y + HANDLE * Math.sin(theta)]; }

  /** Small squares at points: a thousand of them are quicker than discs. */
  function squares(plan, points, colour, half) {
    plan.context.fillStyle = colour;
    for (let k = 0; k < points.length; k += 2) {
      const [x, y] = plan.at(points[k], points[k + 1]);
      plan.context.fillRect(x - half, y - half, 2 * half, 2 * half);
    }
  }

  /** In the lower right corner the scores of all shifts, blue the worst and white-hot the best, with a cross at the guess. */
  function paintScores(plan, colours, guess) {
    const {context} = plan, n = 2 * SHIFTS + 1, side = Math.min(150, 0.3 * plan.width), size = side / n, surface = guess.surface();
    const left = plan.width - side - 8, top = plan.height - side - 8;
    surface.forEach((share, k) => {
      context.fillStyle = `hsl(${220 - 175 * share}, 75%, ${12 + 75 * share}%)`;
      context.fillRect(left + (k % n) * size, top + (n - 1 - Math.floor(k / n)) * size, size + 0.5, size + 0.5);
    });
    const [x, y] = [left + (guess.shift[0] / SHIFT + SHIFTS + 0.5) * size, top + (SHIFTS + 0.5 - guess.shift[1] / SHIFT) * size];
    for (const [colour, width] of [["#1b1b1b", 5], ["#ffffff", 2]]) {
      Object.assign(context, {strokeStyle: colour, lineWidth: width});
      context.beginPath();
      context.moveTo(x - 8, y);
      context.lineTo(x + 8, y);
      context.moveTo(x, y - 8);
      context.lineTo(x, y + 8);
      context.stroke();
    }
  }

  function sentence(guess) {
    const [dx, dy] = guess.shift, best = Math.max(...guess.surface());
    return `Moved by ${dx.toFixed(2)}, ${dy.toFixed(2)} metres and turned by ${guess.turn.toFixed(1)} degrees, the scan reaches ` +
      `${(100 * guess.share).toFixed(0)} percent; the best shift at this heading reaches ${(100 * best).toFixed(0)}.`;
  }
})(globalThis);
