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

  /** Apply the motion model, control after control, from `start`: poses Float64Array(3 (K + 1)), headings unwrapped. Eq. 5. */
  function integrate({v, omega, dt}, start) {
    const poses = new Float64Array(3 * (v.length + 1));
    poses.set(start);
    for (let k = 0; k < v.length; k++) {
      const at = 3 * k, theta = poses[at + 2];
      poses[at + 3] = poses[at] + dt * v[k] * Math.cos(theta);
      poses[at + 4] = poses[at + 1] + dt * v[k] * Math.sin(theta);
      poses[at + 5] = theta + dt * omega[k];
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
    return Uint8Array.from(grid.logOdds, value => (value > 0 ? 1 : 0));
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
    if (kind === "occupied") return Float32Array.from(occupied);
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

  /** Draw ancestors Int32Array(N): one random offset `u` in [0, 1), then N equal strides through the summed weights. */
  function systematicResample(weights, u) {
    const n = weights.length, edges = new Float64Array(n), ancestors = new Int32Array(n);
    let total = 0, last = 0;
    for (let k = 0; k < n; k++) {
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
    ancestors.forEach((from, to) => copies.set(poses.subarray(3 * from, 3 * from + 3), 3 * to));
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
    freeCells(spec, points_w, sensor_w).forEach((crossed, k) => { if (crossed) said[k] = -1; });
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

  const core = {
    wrapAngle, motionModel, yawRate, wheelTurns, integrate, trajectoryError, predict, beamAngles, isValid, scanPoints, transformPoints, worldToCell, contains, occupied,
    mapCorrelation, scoreField, scores, logLikelihood, logSumExp, reweight, effectiveSampleSize, systematicResample,
    chosen, averagePose, probability, doorAfter, traceRay, freeCells, evidence, addEvidence, integrateScan, castRays,
    generator,
  };
  root.pfslam = Object.assign(root.pfslam || {}, {core});
})(globalThis);
