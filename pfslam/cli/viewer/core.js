/* The equations of the book in the browser: one pure function each, named as in the package `pfslam`.
 *
 * Nothing here draws, waits, or draws lots: random numbers are arguments. A test runs every function on inputs that
 * Python made and compares: whole numbers are equal, all others agree to 1e-12.
 *
 * Shapes, as in the package, in flat arrays:
 *   poses    Float64Array(3 N)   x (m), y (m), theta (rad) of one pose after the other
 *   points   Float64Array(2 M)   x, y (m); points_b in the body frame, points_w in the world
 *   cells    Int32Array(2 M)     ix, iy
 *   spec     {origin: [x, y], resolution, shape: [H, W]}   origin is the outer corner of cell [0, 0], in m
 *   grid     {spec, logOdds: Float32Array(H W)}            row 0 at y_min
 *   lidar    {angleMin, angleMax, beams, rangeMin, rangeMax, position: [x, y]}   rad and m, in the body frame
 */
(function (root) {
  "use strict";

  /** The score of an end point at squared distance 0, 1, 2, ... (cells) from an occupied cell, and how far it reaches. */
  const REACH = 4;
  const NEAREST = 0.35;  // m: so far from a place may be the floor that is meant by it
  const CREDIT = Array.from({length: REACH * REACH + 1}, (_, d2) => Math.round(1000 * Math.exp(-0.5 * d2)));

  /** Bring an angle (rad) into (-pi, pi]. */
  function wrapAngle(theta) {
    let rest = (Math.PI - theta) % (2 * Math.PI);
    if (rest < 0) rest += 2 * Math.PI;
    const wrapped = Math.PI - rest;
    return wrapped > -Math.PI ? wrapped : Math.PI;
  }

  /** Move poses for `dt` s at `v` m/s and `omega` rad/s (one each, or one per pose), Euler step. Eq. 1, 3, 5. */
  function motionModel(poses, v, omega, dt) {
    const moved = new Float64Array(poses.length);
    for (let k = 0; 3 * k < poses.length; k++) {
      const theta = poses[3 * k + 2], speed = v.length ? v[k] : v, turn = omega.length ? omega[k] : omega;
      moved[3 * k] = poses[3 * k] + dt * speed * Math.cos(theta);
      moved[3 * k + 1] = poses[3 * k + 1] + dt * speed * Math.sin(theta);
      moved[3 * k + 2] = wrapAngle(theta + dt * turn);
    }
    return moved;
  }

  /** The true-scale yaw rates Float64Array(K) of measured ones, rad/s. `imu` is {gyroBias (rad/s), gyroScale}. */
  function yawRate(measured, imu) {
    return Float64Array.from(measured, rate => imu.gyroScale * (rate - imu.gyroBias));
  }

  /** The turns Float64Array(K) in rad of a robot whose sides run the distances `left` and `right` (m), `track` m apart. */
  function wheelTurns(left, right, track) {
    return Float64Array.from(left, (distance, k) => (right[k] - distance) / track);
  }

  /** Apply the motion model, control after control, from `start`: poses Float64Array(3 (K + 1)), headings unwrapped. Eq. 5.
   *
   * `dt` (s) is one number, or one for each control.
   */
  function integrate({v, omega, dt}, start) {
    const poses = new Float64Array(3 * (v.length + 1));
    poses.set(start);
    for (let k = 0; k < v.length; k++) {
      const at = 3 * k, theta = poses[at + 2], tau = dt.length ? dt[k] : dt;
      poses[at + 3] = poses[at] + tau * v[k] * Math.cos(theta);
      poses[at + 4] = poses[at + 1] + tau * v[k] * Math.sin(theta);
      poses[at + 5] = theta + tau * omega[k];
    }
    return poses;
  }

  /** How far `poses` are from `truePoses` at the same times: {ateRmse (m), ateMax (m), headingRmse (degrees)}. */
  function trajectoryError(poses, truePoses) {
    let squares = 0, turns = 0, most = 0;
    for (let at = 0; at < poses.length; at += 3) {
      const d2 = (poses[at] - truePoses[at]) ** 2 + (poses[at + 1] - truePoses[at + 1]) ** 2;
      squares += d2;
      turns += wrapAngle(poses[at + 2] - truePoses[at + 2]) ** 2;
      most = Math.max(most, d2);
    }
    const n = poses.length / 3;
    return {ateRmse: Math.sqrt(squares / n), ateMax: Math.sqrt(most), headingRmse: Math.sqrt(turns / n) * 180 / Math.PI};
  }

  /** Drive every particle for `dt` s by its own noisy control. Eq. 11.
   *
   * `noise` is {sigmaV (m/s), sigmaOmega (rad/s), perRootSecond}: the last reads both as densities, so that the spread
   * does not depend on the rate. `normals` Float64Array(2 N) are standard normal numbers: N for v, then N for omega.
   */
  function predict(poses, v, omega, dt, noise, normals) {
    const n = poses.length / 3, scale = noise.perRootSecond ? 1 / Math.sqrt(dt) : 1;
    const vs = new Float64Array(n), omegas = new Float64Array(n);
    for (let k = 0; k < n; k++) {
      vs[k] = v + scale * noise.sigmaV * normals[k];
      omegas[k] = omega + scale * noise.sigmaOmega * normals[n + k];
    }
    return motionModel(poses, vs, omegas, dt);
  }

  /** The angles Float64Array(beams) of the beams in the LiDAR's frame (rad). */
  function beamAngles(lidar) {
    const step = (lidar.angleMax - lidar.angleMin) / Math.max(lidar.beams - 1, 1);
    const angles = Float64Array.from({length: lidar.beams}, (_, k) => k * step + lidar.angleMin);
    if (lidar.beams > 1) angles[lidar.beams - 1] = lidar.angleMax;
    return angles;
  }

  /** Whether a range (m) is a measurement: finite and within the LiDAR's limits. */
  function isValid(range, lidar) {
    return range >= lidar.rangeMin && range < lidar.rangeMax;  // false for NaN
  }

  /** End points (body frame) of the valid beams of `ranges` Float64Array(beams), m. Eq. 7. */
  function scanPoints(ranges, lidar) {
    const angles = beamAngles(lidar), points = [];
    for (let k = 0; k < lidar.beams; k++) {
      if (!isValid(ranges[k], lidar)) continue;
      points.push(ranges[k] * Math.cos(angles[k]) + lidar.position[0]);
      points.push(ranges[k] * Math.sin(angles[k]) + lidar.position[1]);
    }
    return Float64Array.from(points);
  }

  /** Points of the body frame in the world, for the body at `pose` [x, y, theta]. */
  function transformPoints(pose, points_b) {
    const c = Math.cos(pose[2]), s = Math.sin(pose[2]), points_w = new Float64Array(points_b.length);
    for (let k = 0; k < points_b.length; k += 2) {
      points_w[k] = pose[0] + c * points_b[k] - s * points_b[k + 1];
      points_w[k + 1] = pose[1] + s * points_b[k] + c * points_b[k + 1];
    }
    return points_w;
  }

  /** The cells of points: floor((p - origin) / resolution). */
  function worldToCell(spec, points_w) {
    const cells = new Int32Array(points_w.length);
    for (let k = 0; k < points_w.length; k++) {
      cells[k] = Math.floor((points_w[k] - spec.origin[k % 2]) / spec.resolution);
    }
    return cells;
  }

  /** Whether the cell (ix, iy) lies inside the grid. */
  function contains(spec, ix, iy) {
    return ix >= 0 && iy >= 0 && ix < spec.shape[1] && iy < spec.shape[0];
  }

  /** The cells that are more likely occupied than free, Uint8Array(H W): log-odds above 0. */
  function occupied(grid) {
    const cells = new Uint8Array(grid.logOdds.length);
    for (let k = 0; k < cells.length; k++) if (grid.logOdds[k] > 0) cells[k] = 1;
    return cells;
  }

  /** Count the points (world, m) on occupied cells; outside the grid nothing counts. Eq. 6, 8, 9. */
  function mapCorrelation(occupied, spec, points_w) {
    const cells = worldToCell(spec, points_w);
    let count = 0;
    for (let k = 0; k < cells.length; k += 2) {
      if (contains(spec, cells[k], cells[k + 1]) && occupied[cells[k + 1] * spec.shape[1] + cells[k]]) count += 1;
    }
    return count;
  }

  /** What an end point scores in each cell, Float32Array(H W).
   *
   * "occupied": 1 on occupied cells, the report's count. "distance": 1000 exp(-d^2 / 2) with d the distance in cells to
   * the nearest occupied cell, cut off at 4 cells: the likelihood field, in which a near miss scores too.
   */
  function scoreField(occupied, spec, kind) {
    if (kind === "occupied") return new Float32Array(occupied);
    const [height, width] = spec.shape, field = new Float32Array(height * width);
    for (let iy = 0; iy < height; iy++) {
      for (let ix = 0; ix < width; ix++) {
        if (!occupied[iy * width + ix]) continue;
        for (let y = Math.max(iy - REACH, 0); y <= Math.min(iy + REACH, height - 1); y++) {
          for (let x = Math.max(ix - REACH, 0); x <= Math.min(ix + REACH, width - 1); x++) {
            const credit = CREDIT[(x - ix) ** 2 + (y - iy) ** 2] || 0;
            if (credit > field[y * width + x]) field[y * width + x] = credit;
          }
        }
      }
    }
    return field;
  }

  /** What the end points `points_b` score at each pose: the sums of the field's values, Float64Array(N). Eq. 6 to 9. */
  function scores(field, spec, points_b, poses) {
    const sums = new Float64Array(poses.length / 3), [height, width] = spec.shape;
    for (let n = 0; n < sums.length; n++) {
      const x = poses[3 * n], y = poses[3 * n + 1], c = Math.cos(poses[3 * n + 2]), s = Math.sin(poses[3 * n + 2]);
      for (let k = 0; k < points_b.length; k += 2) {
        const ix = Math.floor((x + c * points_b[k] - s * points_b[k + 1] - spec.origin[0]) / spec.resolution);
        const iy = Math.floor((y + s * points_b[k] + c * points_b[k + 1] - spec.origin[1]) / spec.resolution);
        if (ix >= 0 && iy >= 0 && ix < width && iy < height) sums[n] += field[iy * width + ix];
      }
    }
    return sums;
  }

  /** Log-likelihoods of scores: `sharpness` times the share of `full` reached, or, with sharpness null, the logarithm of
   * the count (the report's choice in Eq. 12). */
  function logLikelihood(scores, full, sharpness) {
    return Float64Array.from(scores, score => (sharpness === null ? Math.log(score) : sharpness * (score / full)));
  }

  /** log(sum(exp(values))) without overflow; -Infinity if every value is. */
  function logSumExp(values) {
    const top = values.reduce((a, b) => Math.max(a, b), -Infinity);
    return top === -Infinity ? top : top + Math.log(values.reduce((sum, value) => sum + Math.exp(value - top), 0));
  }

  /** Multiply weights by likelihoods and normalise, as logarithms: {logWeights, logEvidence}. Eq. 12.
   *
   * If no particle has any likelihood, the weights come back as they were, with evidence -Infinity.
   */
  function reweight(logWeights, logLikelihood) {
    const joint = logWeights.map((weight, k) => weight + logLikelihood[k]), logEvidence = logSumExp(joint);
    if (logEvidence === -Infinity) return {logWeights, logEvidence};
    return {logWeights: joint.map(value => value - logEvidence), logEvidence};
  }

  /** N_eff = 1 / sum(w^2) of weights that sum to 1: 1 if one has all, N if all are equal. Eq. 13. */
  function effectiveSampleSize(weights) {
    return 1 / weights.reduce((sum, weight) => sum + weight * weight, 0);
  }

  /** Draw `n` ancestors Int32Array(n): one random offset `u` in [0, 1), then n equal strides through the summed weights. */
  function systematicResample(weights, u, n = weights.length) {
    const edges = new Float64Array(weights.length), ancestors = new Int32Array(n);
    let total = 0, last = 0;
    for (let k = 0; k < weights.length; k++) {
      edges[k] = total += weights[k];
      if (weights[k] > 0) last = k;  // round-off may leave the last edge short of 1
    }
    for (let k = 0, at = 0; k < n; k++) {
      const position = (k + u) / n;
      while (at < last && edges[at] / total <= position) at += 1;
      ancestors[k] = at;
    }
    return ancestors;
  }

  /** The poses of the ancestors, one after the other. */
  function chosen(poses, ancestors) {
    const copies = new Float64Array(3 * ancestors.length);
    for (let k = 0; k < copies.length; k++) copies[k] = poses[3 * ancestors[Math.floor(k / 3)] + (k % 3)];
    return copies;
  }

  /** The weighted mean of poses as one pose [x, y, theta]; the heading is averaged on the circle. */
  function averagePose(poses, weights) {
    let x = 0, y = 0, c = 0, s = 0, total = 0;
    for (let k = 0; k < weights.length; k++) {
      total += weights[k];
      x += weights[k] * poses[3 * k];
      y += weights[k] * poses[3 * k + 1];
      c += weights[k] * Math.cos(poses[3 * k + 2]);
      s += weights[k] * Math.sin(poses[3 * k + 2]);
    }
    return [x / total, y / total, Math.atan2(s, c)];
  }

  /** The probability of log-odds: 1 / (1 + exp(-lambda)). Eq. 14. */
  function probability(logOdds) {
    return 1 / (1 + Math.exp(-logOdds));
  }

  /** Bayes for one cell of a map of doors: the probability `door` after a look, and how probable that look was. */
  function doorAfter(door, seesDoor, seenAtDoor, seenAtWall) {
    const atDoor = seesDoor ? seenAtDoor : 1 - seenAtDoor, atWall = seesDoor ? seenAtWall : 1 - seenAtWall;
    const likelihood = door * atDoor + (1 - door) * atWall;
    return {door: (door * atDoor) / likelihood, likelihood};
  }

  /** The cells that a ray crosses from cell `start` [ix, iy] to cell `end`, the end left out: Bresenham, whole numbers. */
  function traceRay(start, end) {
    const dx = end[0] - start[0], dy = end[1] - start[1], n = Math.max(Math.abs(dx), Math.abs(dy));
    const cells = new Int32Array(2 * n);
    for (let k = 0; k < n; k++) {
      cells[2 * k] = start[0] + Math.sign(dx) * Math.floor((2 * k * Math.abs(dx) + n) / (2 * n));
      cells[2 * k + 1] = start[1] + Math.sign(dy) * Math.floor((2 * k * Math.abs(dy) + n) / (2 * n));
    }
    return cells;
  }

  /** Mark the cells of the grid that a scan saw through, Uint8Array(H W): those of every beam but its end. */
  function freeCells(spec, points_w, sensor_w) {
    const ends = worldToCell(spec, points_w), start = worldToCell(spec, sensor_w);
    const mask = new Uint8Array(spec.shape[0] * spec.shape[1]);
    for (let k = 0; k < ends.length; k += 2) {
      const ray = traceRay(start, [ends[k], ends[k + 1]]);
      for (let j = 0; j < ray.length; j += 2) {
        if (contains(spec, ray[j], ray[j + 1])) mask[ray[j + 1] * spec.shape[1] + ray[j]] = 1;
      }
    }
    return mask;
  }

  /** What one scan says about each cell, Int8Array(H W): 1 if a beam ended in it, else -1 if one passed, else 0. */
  function evidence(spec, points_w, sensor_w) {
    const said = new Int8Array(spec.shape[0] * spec.shape[1]), ends = worldToCell(spec, points_w);
    const crossed = freeCells(spec, points_w, sensor_w);
    for (let k = 0; k < said.length; k++) said[k] = -crossed[k];
    for (let k = 0; k < ends.length; k += 2) {
      if (contains(spec, ends[k], ends[k + 1])) said[ends[k + 1] * spec.shape[1] + ends[k]] = 1;
    }
    return said;
  }

  /** Add what a scan says to the map and return the new grid; `config` as for `integrateScan`. Eq. 15. */
  function addEvidence(grid, said, config) {
    const {spec} = grid, logOdds = grid.logOdds.slice(), clamp = Math.fround(config.clamp);
    const change = [Math.fround(-config.free), 0, Math.fround(config.hit)];
    for (let k = 0; k < said.length; k++) {
      if (said[k]) logOdds[k] = Math.max(-clamp, Math.min(clamp, Math.fround(logOdds[k] + change[said[k] + 1])));
    }
    return {spec, logOdds};
  }

  /** Write one scan into the map and return the new grid. Eq. 15.
   *
   * `config` is {hit, free, clamp}, positive amounts of log-odds. Every cell is written once per scan, hit or free, and a
   * hit wins. The sums are float32, as in the package.
   */
  function integrateScan(grid, points_w, sensor_w, config) {
    return addEvidence(grid, evidence(grid.spec, points_w, sensor_w), config);
  }

  /** Distances Float64Array(beams) in m from the sensor at `pose` to what each beam at `angles` meets first.
   *
   * `walls` Float64Array(4 W) are segments x1, y1, x2, y2; `discs` Float64Array(3 D) are x, y, radius (people).
   * A beam that meets nothing has Infinity.
   */
  function castRays(walls, discs, pose, angles) {
    const ranges = new Float64Array(angles.length).fill(Infinity);
    for (let k = 0; k < angles.length; k++) {
      const dx = Math.cos(pose[2] + angles[k]), dy = Math.sin(pose[2] + angles[k]);
      for (let w = 0; w < walls.length; w += 4) {
        // sensor + t d = begin + s edge, by Cramer's rule.
        const bx = walls[w] - pose[0], by = walls[w + 1] - pose[1];
        const ex = walls[w + 2] - walls[w], ey = walls[w + 3] - walls[w + 1], across = dx * ey - dy * ex;
        const t = (bx * ey - by * ex) / across, s = (bx * dy - by * dx) / across;
        if (t > 0 && s >= 0 && s <= 1 && t < ranges[k]) ranges[k] = t;
      }
      for (let d = 0; d < discs.length; d += 3) {
        const cx = discs[d] - pose[0], cy = discs[d + 1] - pose[1], ahead = cx * dx + cy * dy;
        const inside = ahead * ahead - (cx * cx + cy * cy - discs[d + 2] * discs[d + 2]);
        const t = ahead - Math.sqrt(inside);  // NaN where the beam passes by
        if (t > 0 && t < ranges[k]) ranges[k] = t;
      }
    }
    return ranges;
  }

  /** A generator of random numbers with a seed: sfc32 of the PractRand suite. The same seed gives the same numbers.
   *
   * `uniform()` is a number in [0, 1); `normals(n)` Float64Array(n) are standard normal (Box and Muller).
   */
  function generator(seed) {
    let a = 0, b = seed >>> 0, c = 0, counter = 1;
    function bits() {
      const t = (a + b + counter) | 0;
      counter = (counter + 1) | 0;
      a = b ^ (b >>> 9);
      b = (c + (c << 3)) | 0;
      c = (c << 21) | (c >>> 11);
      c = (c + t) | 0;
      return t >>> 0;
    }
    const uniform = () => bits() / 4294967296;
    function normals(n) {
      const numbers = new Float64Array(n);
      for (let k = 0; k < n; k += 2) {
        const radius = Math.sqrt(-2 * Math.log(1 - uniform())), angle = 2 * Math.PI * uniform();
        numbers[k] = radius * Math.cos(angle);
        numbers[k + 1] = radius * Math.sin(angle);  // past the end of an odd number it is lost
      }
      return numbers;
    }
    for (let k = 0; k < 15; k++) bits();  // until the seed has reached every bit
    return {uniform, normals};
  }

  /** The pose after a motion [dx, dy, dtheta] that begins at a pose: its axes are those of the pose. */
  function compose(pose, motion) {
    const c = Math.cos(pose[2]), s = Math.sin(pose[2]);
    return [pose[0] + c * motion[0] - s * motion[1], pose[1] + s * motion[0] + c * motion[1], wrapAngle(pose[2] + motion[2])];
  }

  /** Poses Float64Array(3 N), each after a motion of its own, Float64Array(3 N). */
  function composeEach(poses, motions) {
    const moved = new Float64Array(poses.length);
    for (let k = 0; k < poses.length; k += 3) {
      const c = Math.cos(poses[k + 2]), s = Math.sin(poses[k + 2]);
      moved[k] = poses[k] + c * motions[k] - s * motions[k + 1];
      moved[k + 1] = poses[k + 1] + s * motions[k] + c * motions[k + 1];
      moved[k + 2] = wrapAngle(poses[k + 2] + motions[k + 2]);
    }
    return moved;
  }

  /** The pose [x, y, theta] at time t between poses [x, y, theta] at increasing times. It turns the shorter way round, and
   * where it turns by more than 0.1 rad it goes along an arc. */
  function poseAt(times, poses, t) {
    const next = times.findIndex(time => time > t), k = Math.max(0, (next < 0 ? times.length : next) - 1);
    const i = Math.min(k, times.length - 2), part = (t - times[i]) / (times[i + 1] - times[i]), a = poses[i], b = poses[i + 1];
    const turn = wrapAngle(b[2] - a[2]), half = Math.abs(turn) > 0.1 ? 0.5 * turn : 0, back = (1 - part) * half;
    const length = half ? Math.sin(part * half) / Math.sin(half) : part, c = length * Math.cos(back), s = length * Math.sin(back);
    const dx = b[0] - a[0], dy = b[1] - a[1];
    return [a[0] + c * dx + s * dy, a[1] + c * dy - s * dx, wrapAngle(a[2] + part * turn)];
  }

  /** The log-likelihood Float32Array(H W) of an end point in each cell, for a robot that is lost:
   * log(random + (1 - random) exp(-d^2 / 2 sigma^2)), with d (m) the distance to the nearest occupied cell. */
  function likelihoodField(occupied, spec, {sigma, random}) {
    const [height, width] = spec.shape, scale = spec.resolution / sigma, reach = Math.ceil(6 / scale), most = reach * reach;
    const values = Float32Array.from({length: most + 1}, (_, d2) => Math.log(random + (1 - random) * Math.exp(-0.5 * d2 * scale ** 2)));
    const along = new Int32Array(height * width).fill(most), field = new Float32Array(height * width);  // squared, in the row alone
    for (let k = 0; k < along.length; k++) {
      if (!occupied[k]) continue;
      const row = k - (k % width);
      for (let j = Math.max(k - reach, row); j <= Math.min(k + reach, row + width - 1); j++) along[j] = Math.min(along[j], (j - k) ** 2);
    }
    for (let k = 0; k < field.length; k++) {
      const iy = Math.floor(k / width);
      let least = most;
      for (let dy = Math.max(-reach, -iy); dy <= Math.min(reach, height - 1 - iy); dy++) {
        least = Math.min(least, along[k + dy * width] + dy * dy);
      }
      field[k] = values[least];
    }
    return field;
  }

  /** The log-likelihood Float64Array(N) of a scan from each pose: the mean of the field over its end points times `beams`.
   * Outside the map, and for who would stand on a cell that is not free (`free` Uint8Array(H W)), nothing explains it. */
  function lostLogLikelihood(field, spec, free, points_b, poses, {random, beams}) {
    const gain = new Float64Array(poses.length / 3), [height, width] = spec.shape, none = Math.log(random), count = points_b.length / 2;
    for (let n = 0; n < gain.length; n++) {
      const x = poses[3 * n], y = poses[3 * n + 1], c = Math.cos(poses[3 * n + 2]), s = Math.sin(poses[3 * n + 2]);
      const ix = Math.floor((x - spec.origin[0]) / spec.resolution), iy = Math.floor((y - spec.origin[1]) / spec.resolution);
      let sum = 0;
      if (!(contains(spec, ix, iy) && free[iy * width + ix])) { gain[n] = beams * none; continue; }
      for (let k = 0; k < points_b.length; k += 2) {
        const jx = Math.floor((x + c * points_b[k] - s * points_b[k + 1] - spec.origin[0]) / spec.resolution);
        const jy = Math.floor((y + s * points_b[k] + c * points_b[k + 1] - spec.origin[1]) / spec.resolution);
        sum += jx >= 0 && jy >= 0 && jx < width && jy < height ? field[jy * width + jx] : none;
      }
      gain[n] = (beams * sum) / count;
    }
    return gain;
  }

  /** How many particles a cloud over so many bins needs, so that its Kullback-Leibler distance stays below 0.05 with
   * probability 0.99: Fox's bound, with the chi-square quantile by Wilson and Hilferty. */
  function kldBound(bins) {
    const k = Math.max(bins - 1, 1), a = 2 / (9 * k);
    return bins > 1 ? (k / (2 * 0.05)) * (1 - a + Math.sqrt(a) * 2.3263478740408408) ** 3 : 1;
  }

  /** How many of the poses, taken in order, meet Fox's bound for the bins (0.5 m, 0.5 m, 10 degrees) that they lie in. */
  function enough(poses, least) {
    const bins = new Set();
    for (let k = 0; 3 * k < poses.length; k++) {
      const [x, y, theta] = [poses[3 * k], poses[3 * k + 1], poses[3 * k + 2]];
      bins.add(Math.floor(x / 0.5) * 1e6 + Math.floor(y / 0.5) * 1e3 + Math.floor((theta * 18) / Math.PI));
      if (k + 1 >= Math.max(kldBound(bins.size), least)) return k + 1;
    }
    return poses.length / 3;
  }

  /** Pose b seen from pose a: [dx, dy, dtheta] in the axes of a. */
  function between(a, b) {
    const c = Math.cos(a[2]), s = Math.sin(a[2]), dx = b[0] - a[0], dy = b[1] - a[1];
    return [c * dx + s * dy, c * dy - s * dx, wrapAngle(b[2] - a[2])];
  }

  /** The error of an edge {i, j, z, information} of a pose graph: pose j seen from pose i, less what was measured. */
  function edgeError({i, j, z}, poses) {
    const [x, y, theta] = between(poses[i], poses[j]);
    return [x - z[0], y - z[1], wrapAngle(theta - z[2])];
  }

  /** The squared error of an edge in standard deviations; `information` is the diagonal of its matrix. */
  function chiSquare(edge, poses) {
    return edgeError(edge, poses).reduce((sum, e, k) => sum + edge.information[k] * e * e, 0);
  }

  /** The weight of a squared error under Geman and McClure's kernel of a width. */
  function robustWeight(chi2, width) { return width === Infinity ? 1 : (width ** 2 / (width ** 2 + chi2)) ** 2; }

  /** One step of Gauss and Newton: the poses after it. The first is held fast; `weights` has one number for each edge. */
  function graphStep(edges, poses, weights) {
    const n = 3 * poses.length, H = Array.from({length: n}, () => new Float64Array(n)), b = new Float64Array(n);
    edges.forEach((edge, number) => {
      const {i, j, information} = edge, error = edgeError(edge, poses), [x, y] = between(poses[i], poses[j]);
      const c = Math.cos(poses[i][2]), s = Math.sin(poses[i][2]);
      const J = [[-c, -s, y, c, s, 0], [s, -c, -x, -s, c, 0], [0, 0, -1, 0, 0, 1]];
      const at = [3 * i, 3 * i + 1, 3 * i + 2, 3 * j, 3 * j + 1, 3 * j + 2];
      for (let row = 0; row < 3; row++) {
        const w = weights[number] * information[row];
        for (let p = 0; p < 6; p++) {
          b[at[p]] += w * J[row][p] * error[row];
          for (let q = 0; q < 6; q++) H[at[p]][at[q]] += w * J[row][p] * J[row][q];
        }
      }
    });
    const step = solve(H.slice(3).map(row => row.slice(3)), b.slice(3).map(value => -value));
    return poses.map((pose, k) => (k === 0 ? pose.slice()
      : [pose[0] + step[3 * k - 3], pose[1] + step[3 * k - 2], wrapAngle(pose[2] + step[3 * k - 1])]));
  }

  /** Solve A x = b for a symmetric, positive definite A: elimination without pivots. Both are used up. */
  function solve(A, b) {
    const n = b.length;
    for (let k = 0; k < n; k++) {
      for (let row = k + 1; row < n; row++) {
        const share = A[row][k] / A[k][k];
        if (!share) continue;
        for (let column = k; column < n; column++) A[row][column] -= share * A[k][column];
        b[row] -= share * b[k];
      }
    }
    for (let k = n - 1; k >= 0; k--) {
      for (let column = k + 1; column < n; column++) b[k] -= A[k][column] * b[column];
      b[k] /= A[k][k];
    }
    return b;
  }

  /** How deep (m) a disc of a radius at [x, y] would stand in a wall; 0 if it is free. `walls` as for `castRays`. */
  function touches(walls, [px, py], radius) {
    let depth = 0;
    for (let w = 0; w < walls.length; w += 4) {
      const ex = walls[w + 2] - walls[w], ey = walls[w + 3] - walls[w + 1], x = px - walls[w], y = py - walls[w + 1];
      const part = Math.max(0, Math.min(1, (x * ex + y * ey) / (ex * ex + ey * ey))), dx = x - part * ex, dy = y - part * ey;
      if (Math.abs(dx) < radius && Math.abs(dy) < radius) depth = Math.max(depth, radius - Math.hypot(dx, dy));
    }
    return depth;
  }

  /** Whether a disc can move straight from a place to another. */
  function straight(walls, [ax, ay], [bx, by], radius) {
    const steps = Math.ceil(Math.hypot(bx - ax, by - ay) / 0.05);
    for (let k = 1; k <= steps; k++) {
      if (touches(walls, [ax + (k / steps) * (bx - ax), ay + (k / steps) * (by - ay)], radius)) return false;
    }
    return true;
  }

  /** The corners of a way over free ground, by breadth-first search over the cells of a grid; null where there is none. Who
   * asks for a place beside a wall means the floor beside it. */
  function wayTo(walls, spec, from, to, room) {
    if (straight(walls, from, to, room - 0.02)) return [to.slice(0, 2)];
    const [rows, columns] = spec.shape, size = spec.resolution;
    const at = k => [spec.origin[0] + size * (k % columns + 0.5), spec.origin[1] + size * (Math.floor(k / columns) + 0.5)];
    if (!roomy.has(walls)) roomy.set(walls, roomyCells(walls, spec, room));
    const free = roomy.get(walls);
    const nearest = ([x, y]) => {
      const [column, row] = worldToCell(spec, [x, y]), reach = Math.ceil(NEAREST / size);
      let best = -1, least = NEAREST;
      for (let iy = Math.max(row - reach, 0); iy <= Math.min(row + reach, rows - 1); iy++) {
        for (let ix = Math.max(column - reach, 0); ix <= Math.min(column + reach, columns - 1); ix++) {
          const k = iy * columns + ix, away = Math.hypot(at(k)[0] - x, at(k)[1] - y);
          if (free[k] && away < least) [best, least] = [k, away];
        }
      }
      return best;
    };
    const [start, goal] = [nearest(from), nearest(to)];
    if (start < 0 || goal < 0) return null;
    const came = new Int32Array(rows * columns).fill(-1), queue = [goal];
    came[goal] = goal;
    for (let next = 0; next < queue.length && came[start] < 0; next++) {
      for (const step of [1, -1, columns, -columns, columns + 1, columns - 1, 1 - columns, -1 - columns]) {
        const there = queue[next] + step;
        if (free[there] && came[there] < 0) { came[there] = queue[next]; queue.push(there); }
      }
    }
    if (came[start] < 0) return null;
    const cells = [], way = [at(start)];
    for (let k = start; k !== goal; k = came[k]) cells.push(at(k));
    cells.push(at(goal));
    for (let here = 0; here < cells.length - 1;) {  // straight on as far as one can
      let far = cells.length - 1;
      while (far > here + 1 && !straight(walls, cells[here], cells[far], room - 0.02)) far -= 1;
      way.push(cells[far]);
      here = far;
    }
    return way;
  }
  const roomy = new WeakMap();  // by walls: the cells with room for a robot

  /** Mark the cells whose middle is `room` m or more from all walls, Uint8Array(H W). Each wall looks only round itself. */
  function roomyCells(walls, spec, room) {
    const [rows, columns] = spec.shape, {origin: [x0, y0], resolution} = spec, free = new Uint8Array(rows * columns).fill(1);
    for (let w = 0; w < walls.length; w += 4) {
      const wall = walls.slice(w, w + 4), [ax, ay, bx, by] = wall, beyond = [-room, -room, room, room];
      const box = [Math.min(ax, bx), Math.min(ay, by), Math.max(ax, bx), Math.max(ay, by)].map((value, k) => value + beyond[k]);
      const [left, low, right, high] = worldToCell(spec, box);
      for (let iy = Math.max(low, 0); iy <= Math.min(high, rows - 1); iy++) {
        for (let ix = Math.max(left, 0); ix <= Math.min(right, columns - 1); ix++) {
          if (touches(wall, [x0 + resolution * (ix + 0.5), y0 + resolution * (iy + 0.5)], room)) free[iy * columns + ix] = 0;
        }
      }
    }
    return free;
  }

  /** What a driver who sees the robot does on the way to [x, y]: speed and turn, at most `speed` and `turn`. */
  function steer(pose, [x, y], speed, turn) {
    const aside = wrapAngle(Math.atan2(y - pose[1], x - pose[0]) - pose[2]);
    return [speed * Math.max(0, Math.cos(aside)) ** 3, Math.max(-turn, Math.min(turn, 3 * aside))];
  }

  const core = {
    wrapAngle, motionModel, yawRate, wheelTurns, integrate, trajectoryError, predict, beamAngles, isValid, scanPoints, transformPoints, worldToCell, contains, occupied,
    mapCorrelation, scoreField, scores, logLikelihood, logSumExp, reweight, effectiveSampleSize, systematicResample,
    chosen, averagePose, probability, doorAfter, traceRay, freeCells, evidence, addEvidence, integrateScan, castRays,
    generator, between, edgeError, chiSquare, robustWeight, graphStep, compose, composeEach, poseAt, likelihoodField, lostLogLikelihood, kldBound, enough, touches, wayTo, steer,
  };
  root.pfslam = Object.assign(root.pfslam || {}, {core});
})(globalThis);
