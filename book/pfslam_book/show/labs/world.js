/* The one world of the laboratories: a small building, the robot that drives in it, and how a chapter draws both.
 *
 * Half a turn about its middle makes nearly the same building of it: a cupboard at the right end of the corridor is what
 * tells its halves apart (chapter 10). Lengths are in m, angles in rad.
 */
(function (root) {
  "use strict";
  const {core, draw} = root.pfslam;

  const MIDDLE = [4.5, 3], WINDOW = [-0.2, 9.2, -0.2, 6.2];  // what the camera of every chapter shows
  // Every wall has its faces in the middle of cells, but those along the corridor: on the border of two rows they get holes
  // (chapter 02), as beams that end in the outer row pass through the inner one.
  const SPEC = {origin: [-0.425, -0.425], resolution: 0.05, shape: [137, 197]};
  const WAYS = {origin: [-0.4, -0.4], resolution: 0.1, shape: [68, 98]};  // cells on which a driver looks for a way
  const LIDAR = {angleMin: -2.4, angleMax: 2.4, beams: 145, rangeMin: 0.1, rangeMax: 6, position: [0.1, 0]};
  const NOISE = 0.01;  // of a range
  const RADIUS = 0.2, ROOM = RADIUS + 0.08, SPEED = 0.7, TURN = 1.6;  // of the robot; what a way keeps from walls; m/s; rad/s
  const START = [0.7, 3, 0];
  // Along the corridor and back, then through all four rooms.
  const LAP = [[8, 3], [1.7, 3], [1.7, 1.2], [6.9, 1.2], [6.9, 3], [7.3, 3], [7.3, 4.8], [2.1, 4.8], [2.1, 3], [0.7, 3]];

  const box = (x0, y0, x1, y1) => [[x0, y0], [x1, y0], [x1, y1], [x0, y1]];
  const HALF = [
    box(-0.1, -0.1, 9.1, 0), box(9, -0.1, 9.1, 3), box(-0.1, -0.1, 0, 3),
    box(0, 2.125, 1.2, 2.275), box(2.2, 2.125, 6.4, 2.275), box(7.4, 2.125, 9, 2.275),
    box(4.15, 0, 4.25, 0.7), box(4.15, 1.7, 4.25, 2.125), box(0.4, 0.4, 1, 1), box(5.5, 0, 6.1, 0.3), [[8, 0], [9, 0], [9, 1.2]],
  ];
  const turned = solid => solid.map(([x, y]) => [2 * MIDDLE[0] - x, 2 * MIDDLE[1] - y]);
  const CUPBOARD = box(8.65, 2.275, 9, 2.9), BUILT = [...HALF, ...HALF.map(turned)], SOLIDS = [...BUILT, CUPBOARD];

  /** The walls of solids, x1, y1, x2, y2 each. */
  const wallsOf = solids => Float64Array.from(solids.flatMap(solid => solid.flatMap((corner, k) => [...corner, ...solid[(k + 1) % solid.length]])));
  const WALLS = wallsOf(SOLIDS);

  /** The pose half a turn round. */
  const twin = ([x, y, theta]) => [2 * MIDDLE[0] - x, 2 * MIDDLE[1] - y, core.wrapAngle(theta + Math.PI)];

  /** The column (axis 0) or row (axis 1) of a coordinate. */
  const cellOf = (value, axis) => Math.floor((value - SPEC.origin[axis]) / SPEC.resolution);

  /** Mark the cells through which walls run, or along whose border, Uint8Array(H W). */
  function standing(walls) {
    const [rows, columns] = SPEC.shape, cells = new Uint8Array(rows * columns), beside = [-1e-6, 1e-6];
    for (let w = 0; w < walls.length; w += 4) {
      const [dx, dy] = [walls[w + 2] - walls[w], walls[w + 3] - walls[w + 1]], steps = Math.ceil(Math.hypot(dx, dy) / 0.02);
      for (let k = 0; k <= steps; k++) {
        const x = walls[w] + (k / steps) * dx, y = walls[w + 1] + (k / steps) * dy;
        for (const a of beside) for (const b of beside) cells[columns * cellOf(y + b, 1) + cellOf(x + a, 0)] = 1;
      }
    }
    return cells;
  }

  /** The map of the building: its walls, the floor that a robot can reach, and the rest unknown. */
  const known = once(() => {
    const occupied = standing(WALLS), logOdds = new Float32Array(occupied), free = new Uint8Array(occupied.length), columns = SPEC.shape[1];
    const queue = [cellAt(START[0], START[1])];
    logOdds[queue[0]] = -1;
    for (let next = 0; next < queue.length; next++) {
      for (const step of [1, -1, columns, -columns]) {
        const there = queue[next] + step;
        if (logOdds[there] === 0) { logOdds[there] = -1; queue.push(there); }
      }
    }
    for (const k of queue) free[k] = 1;
    return {occupied, free, grid: {spec: SPEC, logOdds}};
  });

  function once(make) {
    let made = null;
    return () => (made = made || make());
  }

  /** What the LiDAR measures from a pose, Float64Array(beams). */
  function scan(pose, dice, walls = WALLS, discs = []) {
    const noise = dice.normals(LIDAR.beams), sensor = [...core.transformPoints(pose, LIDAR.position), pose[2]];
    return core.castRays(walls, discs, sensor, core.beamAngles(LIDAR)).map((range, k) => range + NOISE * noise[k]);
  }

  /** Whether the robot has room at a place inside the building, between walls that stand. */
  const room = ([x, y], walls = WALLS) => x > 0 && x < 9 && y > 0 && y < 6 && known().free[cellAt(x, y)] === 1 && !core.touches(walls, [x, y], RADIUS);

  const cellAt = (x, y) => cellOf(y, 1) * SPEC.shape[1] + cellOf(x, 0);

  /** Whoever drives the robot: arrow keys, a way over free ground to a tapped place, or an autopilot along a `route`. The
   * driver sees the robot at `truth`; only a filter does not know where it is. */
  class Driver {
    park(pose, route, leg = 0) {
      Object.assign(this, {truth: pose.slice(), route, leg, way: [], auto: true, keys: {}, target: null, refused: ""});
    }

    get walls() { return WALLS; }

    wayTo(place) { return core.wayTo(this.walls, WAYS, this.truth, place, ROOM); }

    /** Speed and turn that the driver asks for. */
    command() {
      const {keys: {left, right, up, down}, truth, way, route} = this;
      if (left || right || up || down) return [SPEED * ((up ? 1 : 0) - (down ? 1 : 0)), TURN * ((left ? 1 : 0) - (right ? 1 : 0))];
      if (!way.length) {
        if (!this.auto) { this.target = null; return [0, 0]; }
        this.way = this.wayTo(route[this.leg]) || [];
        this.leg = (this.leg + 1) % route.length;
        return [0, 0];
      }
      if (Math.hypot(way[0][0] - truth[0], way[0][1] - truth[1]) < (way.length > 1 ? 0.04 : 0.15)) { way.shift(); return [0, 0]; }
      return core.steer(truth, way[0], SPEED, TURN);
    }

    /** Move the robot to a pose, unless a wall stops it: then it only turns, and looks for another way. Whether it was stopped. */
    moveTo(pose) {
      const {walls, truth, way} = this, depth = core.touches(walls, pose, RADIUS);
      const stopped = depth > 0 && depth >= core.touches(walls, truth, RADIUS);
      this.truth = stopped ? [truth[0], truth[1], pose[2]] : pose;
      if (stopped && way.length) this.way = this.wayTo(way[way.length - 1]) || [];
      return stopped;
    }

    /** Drive to a place, or say why not. */
    goTo(x, y) {
      const way = this.wayTo([x, y]);
      Object.assign(this, {auto: false, way: way || [], target: way && way[way.length - 1]});
      this.refused = way ? "" : core.touches(this.walls, [x, y], ROOM) ? "There is no room for the robot." : "No way leads there.";
    }

    /** The driver lets go, or takes over. */
    setAuto(auto) { Object.assign(this, {auto, way: [], target: null, refused: ""}); }
  }

  /** The way from a pose to places, one after the other, as controls {start, dt (s), v, omega}. */
  function controlsTo(start, places, dt) {
    const driver = new Driver(), v = [], omega = [];
    for (driver.park(start, places); driver.leg || !v.length || driver.way.length;) {
      const [speed, turn] = driver.command(), stopped = driver.moveTo(Array.from(core.motionModel(driver.truth, speed, turn, dt)));
      v.push(stopped ? 0 : speed);
      omega.push(turn);
    }
    return {start, dt, v, omega};
  }

  /** The floor, as the camera would see it: boards along the corridor, tiles in the rooms, and words. */
  const floor = once(() => {
    const tile = 0.025, [rows, columns] = SPEC.shape, side = SPEC.resolution / tile, width = columns * side, height = rows * side;
    const canvas = Object.assign(document.createElement("canvas"), {width, height}), context = canvas.getContext("2d", {willReadFrequently: true});
    const px = x => (x - SPEC.origin[0]) / tile, py = y => height - (y - SPEC.origin[1]) / tile;
    const fill = (x0, y0, x1, y1, colour) => { context.fillStyle = colour; context.fillRect(px(x0), py(y1), (x1 - x0) / tile, (y1 - y0) / tile); };
    const tiles = (x0, y0, x1, y1, size, ...colours) => {
      for (let i = 0; x0 + i * size < x1; i++) {
        for (let j = 0; y0 + j * size < y1; j++) {
          fill(x0 + i * size, y0 + j * size, Math.min(x1, x0 + (i + 1) * size), Math.min(y1, y0 + (j + 1) * size), colours[(i + j) % colours.length]);
        }
      }
    };
    fill(-1, -1, 10, 7, "#b08a5a");
    tiles(0, 2.2, 9, 3.8, 0.2, "#c99b62", "#bd8d54", "#d2a76f", "#b98449");
    tiles(0, 0, 4.2, 2.2, 0.4, "#5b8db8", "#e9eef2");
    tiles(4.2, 0, 9, 2.2, 0.4, "#6f9e6b", "#dfe9d6");
    tiles(0, 3.8, 4.8, 6, 0.4, "#a8584c", "#efdcc8");
    tiles(4.8, 3.8, 9, 6, 0.4, "#7a6a9c", "#e7e2ef");
    Object.assign(context, {fillStyle: "#3a2a1a", textAlign: "center", textBaseline: "middle", font: `bold ${0.62 / tile}px system-ui, sans-serif`});
    context.fillText("PARTICLE  FILTER", px(4.3), py(3));
    return {width, height, tile, colours: context.getImageData(0, 0, width, height).data, spec: {origin: SPEC.origin, resolution: tile, shape: [height, width]}};
  });

  /** The building from above: its floor, its walls, and what nobody has seen. */
  function paint(plan, colours) {
    const {context} = plan, [left, top] = plan.at(0, 6), [right, bottom] = plan.at(9, 0);
    plan.clear(colours.paper);
    context.fillStyle = colours.free;
    context.fillRect(left, top, right - left, bottom - top);
    context.fillStyle = colours.wall;
    context.beginPath();
    for (const solid of SOLIDS) {
      solid.forEach((corner, k) => context[k ? "lineTo" : "moveTo"](...plan.at(...corner)));
      context.closePath();
    }
    context.fill();
  }

  /** The robot, in the colour of what it is: the truth is filled, all others are beliefs about it. */
  function robot(plan, pose, colours, name) {
    draw.robot(plan, pose, colours[name], {radius: RADIUS, fill: name === "truth" ? colours.muted : colours.free});
  }

  /** The camera as near as `half` m to each side of a place. */
  function near([x, y], half) {
    const high = (half * (WINDOW[3] - WINDOW[2])) / (WINDOW[1] - WINDOW[0]);
    return [x - half, x + half, y - high, y + high];
  }

  /** A dot in a colour of the book, and the words that it explains: on the site they light what has this colour (`layers.js`). */
  function dot(colour, words = "") {
    const mark = `<span class="pfslam-dot" aria-hidden="true" style="color:var(--lab-${colour})">●</span>`;
    return words ? `<span data-layer="${colour}">${mark}\u00a0${words}</span>` : mark;
  }

  root.pfslam.world = {WINDOW, SPEC, LIDAR, RADIUS, ROOM, START, LAP, WALLS, SOLIDS, BUILT, CUPBOARD, Driver, wallsOf, twin, standing, known,
                       room, scan, controlsTo, floor, paint, robot, near, dot};
})(globalThis);
