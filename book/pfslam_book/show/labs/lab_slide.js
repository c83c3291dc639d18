/* Slide the scan (chapter 04): drag and turn a scan over the map; its score and the scores of all shifts follow.
 * The scan was taken at one of the places, or it is cast wherever the reader stands in the building. */
(function (root) {
  "use strict";
  const {core, draw, lab} = root.pfslam;

  const REACH = 3.5, SHIFT = 0.05, SHIFTS = 8;  // m around the robot; m from one shift to the next, so many each way
  const LIMIT = SHIFT * SHIFTS, TURN = 10, RADIUS = 0.2, HANDLE = 1.1;  // m and degrees that the guess may be moved; m; m from robot to handle
  const FULL = {occupied: 1, distance: 1000};  // what a point scores at most
  const RADIANS = Math.PI / 180;
  const STRIDE = 0.1, CLICK = 5;  // m and degrees for a key, when the reader walks

  /** A map, a scan in it, and the guess of where the scan was taken. */
  class Guess {
    constructor({places, building}) {
      Object.assign(this, {places: {...places}, building, kind: "occupied", maps: {}});
      if (building) this.walk(...building.start);
      this.stand(Object.keys(places)[0]);
    }

    /** Stand at x, y (m), facing theta (rad), and take a scan there: rays against the walls of the building, with noise. */
    walk(x, y, theta) {
      if (this.place === "anywhere" && !this.fits(x, y)) return;
      const {walls, lidar, spec, occupied, noise} = this.building, angles = core.beamAngles(lidar), pose = [x, y, theta];
      const sensor = [...core.transformPoints(pose, lidar.position), theta], dice = core.generator(1).normals(lidar.beams);
      const ranges = core.castRays(walls, [], sensor, angles).map((range, k) => range + noise * dice[k]);
      this.places.anywhere = {pose, points: core.scanPoints(ranges, lidar), occupied, spec};
      this.stand("anywhere");
    }

    /** Whether the robot has room at a place of the building. */
    fits(x, y) {
      const {walls, window} = this.building;
      if (x < window[0] || x > window[1] || y < window[2] || y > window[3]) return false;
      const around = core.beamAngles({angleMin: -Math.PI, angleMax: Math.PI, beams: 48});
      return core.castRays(walls, [], [x, y, 0], around).every(range => range > RADIUS && range < 60);
    }

    /** Where the reader stands, if it is a place of the reader's own. */
    get here() { return this.places.anywhere.pose; }

    /** Go to a place: the map as it was then, its scan, and the pose from which the guess starts. */
    stand(name) {
      const {pose, points, occupied, spec} = this.places[name];
      Object.assign(this, {place: name, start: pose, spec, shift: [0, 0], turn: 0, points_b: Float64Array.from(points)});
      if (!this.maps[name]) {
        const cells = new Uint8Array(spec.shape[0] * spec.shape[1]);
        for (const k of occupied) cells[k] = 1;
        this.maps[name] = {cells, fields: {}, grid: {spec, logOdds: Float32Array.from(cells)}};
      }
      Object.assign(this, this.maps[name]);
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
      const full = FULL[this.kind] * Math.max(1, this.points_b.length / 2);  // somebody may stand where nothing is seen
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
    const guess = new Guess(stage.options);
    const window = () => [guess.start[0] - REACH, guess.start[0] + REACH, guess.start[1] - 0.7 * REACH, guess.start[1] + 0.7 * REACH];
    const plan = stage.plan({
      name: "The map and the scan as it lies from the guessed pose",
      help: "Drag the scan, and turn it by the dot before the robot. Keys: arrows slide it by a centimetre, the letters Q and E turn it.",
      window: window(),
    });
    const turned = value => { guess.turn = value; };
    const turn = stage.slider({name: "Turn", min: -TURN, max: TURN, step: 0.1, value: 0, unit: "°", digits: 1, change: turned});
    const go = () => { plan.window = window(); turn.value = 0; turn.dispatchEvent(new Event("input")); };
    const where = stage.choice({name: "Place", options: Object.fromEntries(Object.keys(guess.places).map(name => [name, name])),
                  value: guess.place, change: name => { guess.stand(name); go(); }});
    stage.choice({name: "Score by", options: {occupied: "count of points on walls", distance: "likelihood field"}, value: guess.kind,
                  change: kind => { guess.kind = kind; }});
    stage.button({name: "Start again", key: "n", press: () => { guess.stand(guess.place); go(); }});
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
    if (guess.building) stage.fold("Stand anywhere in the building");
    const facing = guess.building && stage.slider({
      name: "Stand facing", min: -180, max: 180, step: 1, value: guess.here[2] / RADIANS, unit: "°", digits: 0,
      change: value => walk(guess.here[0], guess.here[1], value * RADIANS),
    });
    const overview = guess.building && stroll(stage, guess, walk, facing);
    return {
      state: guess,
      draw() {
        paintMap(plan, stage.colours, guess);
        paintScores(plan, stage.colours, guess);
        if (overview) paintBuilding(overview, stage.colours, guess);
      },
      describe: () => sentence(guess),
    };
  });

  /** A plan of the whole building in which the reader stands anywhere. */
  function stroll(stage, guess, walk, facing) {
    const overview = stage.plan({
      name: "The whole building, and where the robot stands",
      help: "Click, tap or drag in the building to stand there. Keys: arrows walk, the letters Q and E turn.",
      window: guess.building.window,
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

  /** The map of the building, a frame for the piece of it above, and the robot. */
  function paintBuilding(plan, colours, guess) {
    const [x, y, theta] = guess.start, {cells, grid} = guess.maps.anywhere, width = grid.spec.shape[1];
    const store = (plan.ours = plan.ours || document.createElement("canvas"));
    plan.clear(colours.free);
    if (plan.drawnIn !== colours || plan.drawnFor !== plan.width) {  // a wall of one cell would vanish where a pixel holds three of them
      Object.assign(store, {width: plan.canvas.width, height: plan.canvas.height});
      Object.assign(plan, {drawnIn: colours, drawnFor: plan.width});
      const context = store.getContext("2d"), ratio = plan.canvas.width / plan.width;
      context.fillStyle = colours.wall;
      for (let k = 0; k < cells.length; k++) {
        if (!cells[k]) continue;
        const [px, py] = plan.at(grid.spec.origin[0] + (k % width) * grid.spec.resolution,
                                 grid.spec.origin[1] + Math.floor(k / width) * grid.spec.resolution);
        context.fillRect(ratio * px, ratio * py, 1.5, 1.5);
      }
    }
    plan.context.drawImage(store, 0, 0, plan.width, plan.height);
    const [left, top] = plan.at(x - REACH, y + 0.7 * REACH);
    Object.assign(plan.context, {strokeStyle: colours.highlight, lineWidth: 2});
    plan.context.strokeRect(left, top, 2 * REACH * plan.scale, 1.4 * REACH * plan.scale);
    const points_w = core.transformPoints([x, y, theta], guess.points_b);
    squares(plan, points_w, colours.hits, 1);
    draw.robot(plan, [x, y, theta], colours.estimate, {radius: 0.35});
  }

  function paintMap(plan, colours, guess) {
    const {pose, points_b, spec, cells} = guess, points_w = core.transformPoints(pose, points_b), on = [], off = [];
    plan.clear(colours.free);
    // The same object from frame to frame, or the map would be painted anew in each.
    if (plan.tonedFrom !== colours) Object.assign(plan, {tonedFrom: colours, tones: {...colours, paper: colours.free}});
    draw.grid(plan, guess.grid, plan.tones, 1);
    const places = core.worldToCell(spec, points_w);
    for (let k = 0; k < points_w.length; k += 2) {
      const hit = core.contains(spec, places[k], places[k + 1]) && cells[places[k + 1] * spec.shape[1] + places[k]];
      (hit ? on : off).push(points_w[k], points_w[k + 1]);
    }
    squares(plan, off, colours.hits, 1.6);
    squares(plan, on, colours.highlight, 2.4);
    paintHandle(plan, colours, pose, guess.share / Math.max(...guess.surface()));
    draw.robot(plan, pose, colours.estimate, {radius: RADIUS});
    draw.text(plan, `${(100 * guess.share).toFixed(0)} % of the best possible score`, 8, 20, colours.ink, {size: 16, halo: colours.free});
  }

  /** The handle on its line, and a glow round the robot that grows as the scan nears the best shift. */
  function paintHandle(plan, colours, pose, share) {
    const {context} = plan, [x, y] = plan.at(pose[0], pose[1]), [hx, hy] = plan.at(...handle(pose)), near = Math.max(0, 5 * share - 4);
    const glow = context.createRadialGradient(x, y, 0, x, y, 70);
    glow.addColorStop(0, colours.highlight);
    glow.addColorStop(1, `${colours.highlight}00`);
    Object.assign(context, {fillStyle: glow, globalAlpha: 0.7 * near});
    context.fillRect(x - 70, y - 70, 140, 140);
    context.globalAlpha = 1;
    draw.line(plan, [...pose.slice(0, 2), ...handle(pose)], colours.estimate, {width: 1.5, dash: [4, 4]});
    context.beginPath();
    context.arc(hx, hy, 9, 0, 2 * Math.PI);
    Object.assign(context, {fillStyle: colours.free, strokeStyle: colours.estimate, lineWidth: 2.5});
    context.fill();
    context.stroke();
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
    draw.text(plan, "scores of all shifts", plan.width - 8, top - 6, colours.ink,
              {size: plan.width < 500 ? 12 : 14, align: "right", halo: colours.free});
  }

  function sentence(guess) {
    const [dx, dy] = guess.shift, best = Math.max(...guess.surface());
    if (!guess.points_b.length) return "Nothing is seen from here. Stand inside the building.";
    return `Moved by ${dx.toFixed(2)}, ${dy.toFixed(2)} metres and turned by ${guess.turn.toFixed(1)} degrees, the scan reaches ` +
      `${(100 * guess.share).toFixed(0)} percent; the best shift at this heading reaches ${(100 * best).toFixed(0)}.`;
  }
})(globalThis);
