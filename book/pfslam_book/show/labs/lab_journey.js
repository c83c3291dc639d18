/* One pixel's journey (chapter 06): from the depth image to a point in space and to a cell of the map. */
(function (root) {
  "use strict";
  const {core, draw, lab, turn, world} = root.pfslam, {SPEC} = world;

  const NO_READING = 2047, NEAREST = 0.1, FARTHEST = 10;  // the disparity of a hole; m
  const POSE = [1.2, 3, 0], AHEAD = 1.6;  // of the robot, before the letters of the corridor; m to the middle of the floor that is shown
  const HOLES = 3000, HIGH = 2.4, SIGHT = 0.8, RAYS = 1600;  // pixels without a reading; m, of the walls; rad to each side, in so many rays
  const HALF = 2;  // of so many pixels, each way, the colour camera keeps one
  const EVERY = 8;  // of the pixels, each way, one is drawn from the side
  const BRUSH = 10;  // pixels round the chosen one that paint with it
  const SIDE = {x0: -0.2, x1: 8.2, z0: -0.8, z1: 1.5}, END = -0.38;  // the side view; the height at which the line of sight is taken hold of: m

  /** What a depth camera and a colour camera see of the building from one pose. */
  class Shot {
    constructor({camera}) {
      Object.assign(this, {camera, pose: POSE, pixel: {u: 310, v: 413}, painted: new Map()});
      this.settings = {pitch: camera.pitch, tolerance: 0.01};
      const dice = core.generator(1), [x, y] = core.transformPoints(POSE, camera.position.slice(0, 2));
      this.holes = new Set(Array.from({length: HOLES}, () => Math.floor(dice.uniform() * camera.width * camera.height)));
      this.walls = core.castRays(world.WALLS, [], [x, y, POSE[2]], Float64Array.from({length: RAYS}, (_, k) => SIGHT * ((2 * k) / RAYS - 1)));
    }

    /** The image of the colour camera and the thinned pixels: a page waits for them only where they are seen. */
    get image() { return (this.taken ??= this.picture()); }
    get few() { return (this.kept ??= this.thinned()); }

    /** What is seen at a pixel of the depth camera: its depth (m), and its colour [r, g, b]. */
    view(u, v) {
      const c = this.camera, [cos, sin] = [Math.cos(c.pitch), Math.sin(c.pitch)], [right, down] = [(u - c.centreU) / c.focalU, (v - c.centreV) / c.focalV];
      const [ahead, left, up] = [cos - sin * down, -right, -sin - cos * down], along = Math.hypot(ahead, left);
      const ray = Math.max(1, Math.min(RAYS - 1, Math.round((Math.atan2(left, ahead) / SIGHT + 1) * RAYS / 2))), wall = this.walls[ray] / along;
      const floor = up < 0 ? c.position[2] / -up : Infinity, depth = Math.min(floor, wall);
      if (depth === wall) {
        const height = c.position[2] + depth * up, turned = Math.abs(this.walls[ray] - this.walls[ray - 1]) / this.walls[ray] > 0.001;
        const shade = (height < 0.1 ? 120 : height > HIGH ? 250 : turned ? 205 : 175) - 6 * depth;
        return {depth, colour: [shade, shade, shade + 4]};
      }
      const {colours, spec, width, height} = world.floor(), c_w = core.transformPoints(this.pose, [c.position[0] + depth * ahead, depth * left]);
      const [ix, iy] = core.worldToCell(spec, c_w), at = 4 * ((height - 1 - iy) * width + ix);
      return {depth, colour: colours.subarray(at, at + 3)};
    }

    /** The image of the colour camera, in pixels of `HALF`: for each the depth pixel is sought that Eq. 16 takes there. */
    picture() {
      const c = this.camera, [width, height] = [c.width / HALF, c.height / HALF];
      const canvas = Object.assign(document.createElement("canvas"), {width, height});
      const context = canvas.getContext("2d"), image = context.createImageData(width, height);
      for (let k = 0; k < width * height; k++) {
        const v = (HALF * Math.floor(k / width) * c.rgbDivisor - c.rgbOffsetV) / c.rgbFocal;
        const u = inverse => (HALF * (k % width) * c.rgbDivisor - c.rgbOffsetU - c.rgbBaseline * inverse) / c.rgbFocal;
        const first = this.view(u(c.depthScale / 2), v), seen = this.view(u(c.depthScale / first.depth), v);
        image.data.set([...seen.colour, 255], 4 * k);
      }
      context.putImageData(image, 0, 0);
      return {canvas, colours: image.data};
    }

    /** The disparity of a pixel: whole numbers, and none in a hole. */
    at(u, v) {
      const {camera: c} = this;
      return this.holes.has(v * c.width + u) ? NO_READING : Math.round((c.depthScale / this.view(u, v).depth - c.disparityOffset) / c.disparitySlope);
    }

    /** Depth (m) of a disparity; NaN without a reading. The depth of Eq. 17. */
    depth(d) {
      const inverse = this.camera.disparitySlope * d + this.camera.disparityOffset;
      return inverse > 0 && d !== NO_READING ? this.camera.depthScale / inverse : NaN;
    }

    /** The colour pixel of a depth pixel. Eq. 16. */
    colourPixel(u, v, d) {
      const c = this.camera, inverse = c.disparitySlope * d + c.disparityOffset;
      return [(c.rgbFocal * u + c.rgbBaseline * inverse + c.rgbOffsetU) / c.rgbDivisor, (c.rgbFocal * v + c.rgbOffsetV) / c.rgbDivisor];
    }

    /** The point X (right), Y (down), Z (ahead) of the optical frame, m. Eq. 17. */
    optical(u, v, depth) {
      const c = this.camera;
      return [((u - c.centreU) / c.focalU) * depth, ((v - c.centreV) / c.focalV) * depth, depth];
    }

    /** The point in the body frame, for a camera that looks down by the pitch of the slider. */
    body([x, y, z]) {
      const [px, py, pz] = this.camera.position, c = Math.cos(this.settings.pitch), s = Math.sin(this.settings.pitch);
      return [px + c * z - s * y, py - x, pz - s * z - c * y];
    }

    /** The six steps of one pixel, as far as it gets. */
    journey({u, v} = this.pixel) {
      const d = this.at(u, v), depth = this.depth(d), steps = {u, v, d, depth, end: "no reading"};
      if (Number.isNaN(depth)) return steps;
      Object.assign(steps, {colour: this.colourPixel(u, v, d), optical: this.optical(u, v, depth), end: "depth not trusted"});
      steps.body = this.body(steps.optical);
      if (depth < NEAREST || depth > FARTHEST) return steps;
      steps.world = [...core.transformPoints(this.pose, steps.body.slice(0, 2)), steps.body[2]];
      steps.end = "not floor";
      if (Math.abs(steps.world[2]) > this.settings.tolerance) return steps;
      return Object.assign(steps, {cell: Array.from(core.worldToCell(SPEC, steps.world.slice(0, 2))), end: "floor"});
    }

    /** Every few pixels: their colour pixels, and their points in the optical frame. */
    thinned() {
      const {width, height} = this.camera, points = [];
      for (let v = 0; v < height; v += EVERY) {
        for (let u = 0; u < width; u += EVERY) {
          const depth = this.depth(this.at(u, v));
          if (depth <= FARTHEST) points.push([...this.colourPixel(u, v, this.at(u, v)), ...this.optical(u, v, depth)]);
        }
      }
      return points;
    }

    /** The thinned pixels as the pitch has them now, those that count as floor and the others: the `pixels` u, v, u, v, ... of the
     * colour camera, and the `points` x, z, x, z, ... ahead and above the floor (m). */
    fromTheSide() {
      const floor = {pixels: [], points: []}, others = {pixels: [], points: []};
      for (const [u, v, ...point] of this.few) {
        const [x, , z] = this.body(point), {pixels, points} = Math.abs(z) <= this.settings.tolerance ? floor : others;
        pixels.push(u, v);
        points.push(x, z);
      }
      return {floor, others};
    }

    /** The pixels round the chosen one colour the floor, each its cell, if its journey gets there. */
    paint() {
      const {u, v} = this.pixel, {width, height} = this.camera;
      for (let b = Math.max(0, v - BRUSH); b <= Math.min(height - 1, v + BRUSH); b += 2) {
        for (let a = Math.max(0, u - BRUSH); a <= Math.min(width - 1, u + BRUSH); a += 2) {
          const steps = this.journey({u: a, v: b});
          if (steps.end === "floor") this.painted.set(steps.cell.join(), {cell: steps.cell, colour: colourOf(this, steps)});
        }
      }
    }

    choose(u, v) {
      const {width, height} = this.camera, inside = (value, end) => Math.max(0, Math.min(end - 1, Math.floor(value)));
      this.pixel = {u: inside(u, width), v: inside(v, height)};
      this.paint();
    }
  }

  lab("journey", stage => {
    const shot = new Shot(stage.options), {width, height} = shot.camera;
    const plan = stage.plan({
      name: "What the camera sees; the pixel that is followed",
      help: "Point at a pixel, drag, tap, or use the arrow keys, which go faster while you hold them.",
      window: [0, width, -height, 0],
    });
    const side = stage.chart({
      name: "The points of the image from the side, with the ray of the chosen pixel and the camera's line of sight", height: 100,
      help: "From the side: drag the ring at the end of the camera's line of sight to compute with another pitch. Keys: up and down.",
    });
    const degrees = 180 / Math.PI;
    stage.slider({name: "Tolerance", min: 0.2, max: 15, step: 0.1, value: 100 * shot.settings.tolerance, unit: "cm", digits: 1,
                  change: value => { shot.settings.tolerance = value / 100; }});
    const choose = (x, y) => shot.choose(x, -y);
    stage.drag(plan, {start: choose, move: choose});
    plan.canvas.addEventListener("pointermove", event => {
      if (event.pointerType !== "mouse") return;
      choose(...plan.world(event.offsetX, event.offsetY));
      stage.redraw();
    });
    let held = 0;
    const go = (du, dv) => down => {
      held = down ? held + 1 : 0;
      const far = Math.min(8, 1 + Math.floor(held / 6)), {u, v} = shot.pixel;
      if (down) shot.choose(u + far * du, v + far * dv);
    };
    stage.keys(plan, {ArrowLeft: go(-1, 0), ArrowRight: go(1, 0), ArrowUp: go(0, -1), ArrowDown: go(0, 1)});
    const story = stage.words("");
    story.classList.add("pfslam-story");
    stage.controls.after(story);
    stage.fold("More");
    stage.button({name: "Bare floor", key: "n", press: () => shot.painted.clear()});
    const pitch = stage.slider({name: "Pitch", min: 14, max: 22, step: 0.05, value: shot.settings.pitch * degrees, unit: "°",
                                change: value => { shot.settings.pitch = value / degrees; shot.painted.clear(); }});
    const frame = frameOf(side), ring = angle => frame.at(...endOfSight(shot, angle));
    stage.handle(side, {pitch}, (px, py) => {
      const here = ring(shot.settings.pitch), aside = here[0] - px;
      return side.near(px, py, here) ? qx => ({pitch: degrees * pitchTo(shot, frame.world(qx + aside, py)[0])}) : null;
    });
    const tilt = by => down => { if (down) turn(pitch, Number(pitch.value) + by); };
    stage.keys(side, {ArrowUp: tilt(-0.1), ArrowDown: tilt(0.1)});
    return {
      state: shot, constants: {SPEC}, ring,
      draw() {
        side.clear(stage.colours.paper);
        const steps = shot.journey();
        const {colours} = stage, look = [shot.settings.pitch, shot.settings.tolerance, colours];
        draw.kept(plan, look, sheet => paintImage(sheet, colours, shot));
        draw.kept(side, look, sheet => paintPoints(frameOf(sheet), colours, shot));
        paintPixel(plan, colours, steps);
        paintFloor(plan, colours, shot);
        paintRay(frame, colours, shot, steps);
        side.write(`From the side, with a pitch of ${(shot.settings.pitch * degrees).toFixed(2)}°: drag the ring to change it.`);
        story.innerHTML = tell(steps, shot);
      },
      describe: () => sentence(shot.journey(), shot.settings.pitch * degrees),
    };
  });

  /** The colour image, with a green veil on what counts as floor. */
  function paintImage(plan, colours, shot) {
    const {context} = plan, image = {context, at: (u, v) => [u * plan.scale, v * plan.scale]};
    context.drawImage(shot.image.canvas, 0, 0, plan.width, plan.height);
    context.globalAlpha = 0.35;
    draw.specks(image, shot.fromTheSide().floor.pixels, colours.clear, EVERY * plan.scale);
    context.globalAlpha = 1;
  }

  /** The pixel that is followed, with a ring, and its colour pixel, with a cross. */
  function paintPixel(plan, colours, steps) {
    const {context} = plan;
    const [x, y] = plan.at(steps.u + 0.5, -steps.v - 0.5);
    for (const [colour, width] of [["#1b1b1b", 5], [colours.highlight, 2.5]]) {
      Object.assign(context, {strokeStyle: colour, lineWidth: width});
      context.beginPath();
      context.arc(x, y, 9, 0, 2 * Math.PI);
      if (steps.colour) {
        const [cx, cy] = plan.at(steps.colour[0], -steps.colour[1]);
        context.moveTo(cx - 8, cy);
        context.lineTo(cx + 8, cy);
        context.moveTo(cx, cy - 8);
        context.lineTo(cx, cy + 8);
      }
      context.stroke();
    }
  }

  /** In the upper right corner, from above: the piece of the building before the robot, with the floor that has been painted. */
  function paintFloor(plan, colours, shot) {
    const {context} = plan, window = world.near([POSE[0] + AHEAD, POSE[1]], AHEAD + 0.4), width = Math.min(220, 0.4 * plan.width);
    const inset = Object.assign(Object.create(plan), {window, width, height: (width * (window[3] - window[2])) / (window[1] - window[0])});
    context.save();
    context.translate(plan.width - width - 8, 8);
    context.beginPath();
    context.rect(0, 0, width, inset.height);
    context.clip();
    world.paint(inset, colours);
    for (const {cell: [ix, iy], colour} of shot.painted.values()) {
      const [x, y] = inset.at(SPEC.origin[0] + ix * SPEC.resolution, SPEC.origin[1] + (iy + 1) * SPEC.resolution), side = SPEC.resolution * inset.scale + 0.5;
      context.fillStyle = colour;
      context.fillRect(x, y, side, side);
    }
    world.robot(inset, POSE, colours, "truth");
    context.restore();
    plan.write("What the camera sees; in the corner, from above, the floor that you paint.");
  }

  /** The side view in metres: its heights are drawn larger than its lengths, or smaller. */
  function frameOf(side) {
    const {x0, x1, z0, z1} = SIDE;
    return {
      get context() { return side.context; },
      at: (x, z) => [((x - x0) / (x1 - x0)) * side.width, ((z1 - z) / (z1 - z0)) * side.height],
      world: (px, py) => [x0 + (px / side.width) * (x1 - x0), z1 - (py / side.height) * (z1 - z0)],
    };
  }

  /** Where the camera's line of sight, drawn on below the floor, ends in the side view: [x, z], m. */
  function endOfSight({camera: {position: [x, , z]}}, pitch) { return [x + (z - END) / Math.tan(pitch), END]; }

  /** The pitch of a line of sight that ends at x. */
  function pitchTo({camera: {position: [px, , pz]}}, x) { return Math.atan2(pz - END, x - px); }

  /** All points from the side: floor in green. */
  function paintPoints(frame, colours, shot) {
    const {floor, others} = shot.fromTheSide();
    draw.specks(frame, others.points, colours.muted, 2);
    draw.specks(frame, floor.points, colours.clear, 2);
  }

  /** From the side, the ray of the pixel from the camera to its point, and the line of sight. */
  function paintRay(frame, colours, shot, steps) {
    const {at, context} = frame, [px, , pz] = shot.camera.position, {tolerance} = shot.settings;
    const line = (x0, z0, x1, z1, colour, width) => {
      Object.assign(context, {strokeStyle: colour, lineWidth: width});
      context.beginPath();
      context.moveTo(...at(x0, z0));
      context.lineTo(...at(x1, z1));
      context.stroke();
    };
    line(SIDE.x0, tolerance, SIDE.x1, tolerance, colours.ink, 0.75);
    line(SIDE.x0, -tolerance, SIDE.x1, -tolerance, colours.ink, 0.75);
    const [cx, cy] = at(px, pz), end = endOfSight(shot, shot.settings.pitch);
    draw.line(frame, [px, pz, ...end], colours.estimate, {width: 1.5, dash: [4, 4]});
    context.fillStyle = colours.estimate;
    context.fillRect(cx - 5, cy - 5, 10, 10);
    draw.knob(frame, end, colours);
    if (!steps.body) return;
    line(px, pz, steps.body[0], steps.body[2], colours.highlight, 2.5);
    context.beginPath();
    context.arc(...at(steps.body[0], steps.body[2]), 6, 0, 2 * Math.PI);
    context.fillStyle = colourOf(shot, steps);
    context.fill();
    Object.assign(context, {strokeStyle: colours.ink, lineWidth: 2});
    context.stroke();
  }

  function colourOf(shot, {colour}) {
    const [width, height] = [shot.camera.width / HALF, shot.camera.height / HALF], [u, v] = colour.map(value => Math.round(value / HALF));
    const k = 4 * (Math.max(0, Math.min(height - 1, v)) * width + Math.max(0, Math.min(width - 1, u)));
    return `rgb(${shot.image.colours.slice(k, k + 3).join(",")})`;
  }

  const metres = (...values) => values.map(value => value.toFixed(2)).join(", ");

  /** The steps as the table of the chapter has them. */
  function tell(steps, shot) {
    const {u, v, d, colour, optical, depth, world, cell} = steps;
    const lines = [`<b>depth pixel</b> u = ${u}, v = ${v}, d = ${d}`];
    if (colour) lines.push(`<b>1</b> colour pixel ${colour.map(value => value.toFixed(1)).join(", ")}`,
                           `<b>2</b> point ahead of the camera ${metres(...optical)} m`, `<b>3</b> depth ${depth.toFixed(2)} m`);
    if (world) lines.push(`<b>4</b> in the world ${metres(world[0], world[1])}, ${world[2].toFixed(3)} m`);
    if (cell) lines.push("<b>5</b> floor", `<b>6</b> cell [iy = ${cell[1]}, ix = ${cell[0]}] becomes ` +
                         `<span class="pfslam-dot" aria-hidden="true" style="color:${colourOf(shot, steps)}">●</span>`);
    else lines.push(`<b>${steps.end}</b>: the journey ends here`);
    return lines.join("; ");
  }

  function sentence({u, v, depth, body, cell, end}, pitch) {
    const place = body ? `its point is ${depth.toFixed(2)} metres deep and ${(100 * body[2]).toFixed(1)} centimetres above the floor` : "";
    return `Pixel ${u}, ${v}: ${place || end}${cell ? `; it paints cell ${cell[0]}, ${cell[1]}` : place ? `; ${end}` : ""}. ` +
      `It is computed with a pitch of ${pitch.toFixed(2)} degrees.`;
  }
})(globalThis);
