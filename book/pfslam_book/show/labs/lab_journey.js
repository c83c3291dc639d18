/* One pixel's journey (chapter 06): from the depth image to a point in space and to a cell of the map. */
(function (root) {
  "use strict";
  const {core, draw, lab} = root.pfslam;

  const NO_READING = 2047, NEAREST = 0.1, FARTHEST = 10;  // the disparity of a hole; m
  const EVERY = 8;  // of the pixels, each way, one is drawn from the side
  const BRUSH = 10, FLOOR = {side: 0.05, far: 2.6, half: 1};  // pixels; m: a cell, and how far ahead and aside the painted floor goes
  const SIDE = {x0: -0.2, x1: 8.2, z0: -0.6, z1: 1.5};  // the side view, m

  /** One image pair and its camera; the pixels are there as soon as the browser has unpacked them. */
  class Shot {
    constructor({camera, pose, spec, disparity, rgb}, ready) {
      Object.assign(this, {camera, pose, spec, ready: false});
      this.settings = {pitch: camera.pitch, tolerance: 0.01};
      this.pixel = {u: 310, v: 413};
      this.painted = new Map();
      Promise.all([disparity, rgb].map(unpack)).then(([packed, colours]) => {
        this.disparity = Uint16Array.from({length: packed.width * packed.height},
                                          (_, k) => 256 * packed.data[4 * k] + packed.data[4 * k + 1]);
        Object.assign(this, {picture: colours.canvas, colours: colours.data, ready: true, few: this.thinned()});
        ready();
      });
    }

    at(u, v) { return this.disparity[v * this.camera.width + u]; }

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
      return Object.assign(steps, {cell: Array.from(core.worldToCell(this.spec, steps.world.slice(0, 2))), end: "floor"});
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

    /** The pixels round the chosen one colour the floor ahead of the robot, each in its cell, if its journey gets there. */
    paint() {
      if (!this.ready) return;
      const {u, v} = this.pixel, {width, height} = this.camera;
      for (let b = Math.max(0, v - BRUSH); b <= Math.min(height - 1, v + BRUSH); b += 2) {
        for (let a = Math.max(0, u - BRUSH); a <= Math.min(width - 1, u + BRUSH); a += 2) {
          const steps = this.journey({u: a, v: b});
          if (steps.end !== "floor") continue;
          const [x, y] = steps.body;
          this.painted.set(`${Math.floor(x / FLOOR.side)},${Math.floor(y / FLOOR.side)}`, colourOf(this, steps));
        }
      }
    }

    choose(u, v) {
      const {width, height} = this.camera, inside = (value, end) => Math.max(0, Math.min(end - 1, Math.floor(value)));
      this.pixel = {u: inside(u, width), v: inside(v, height)};
      this.paint();
    }
  }

  /** An image as its pixels. */
  function unpack(source) {
    const image = new Image();
    image.src = source;
    return image.decode().then(() => {
      const canvas = Object.assign(document.createElement("canvas"), {width: image.naturalWidth, height: image.naturalHeight});
      const context = canvas.getContext("2d", {willReadFrequently: true});
      context.drawImage(image, 0, 0);
      return {canvas, width: canvas.width, height: canvas.height, data: context.getImageData(0, 0, canvas.width, canvas.height).data};
    });
  }

  lab("journey", stage => {
    const shot = new Shot(stage.options, () => stage.redraw()), {width, height} = shot.camera;
    const plan = stage.plan({
      name: "What the camera sees; the pixel that is followed",
      help: "Point at a pixel, drag, tap, or use the arrow keys, which go faster while you hold them.",
      window: [0, width, -height, 0],
    });
    const side = stage.chart({name: "The points of the image from the side, with the ray of the chosen pixel", height: 150});
    const degrees = 180 / Math.PI;
    stage.slider({name: "Pitch", min: 14, max: 22, step: 0.05, value: shot.settings.pitch * degrees, unit: "°",
                  change: value => { shot.settings.pitch = value / degrees; shot.painted.clear(); }});
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
    stage.button({name: "Bare floor", key: "n", press: () => shot.painted.clear()});
    const story = stage.words("");
    story.classList.add("pfslam-story");
    stage.controls.after(story);
    return {
      state: shot,
      draw() {
        plan.clear(stage.colours.paper);
        side.clear(stage.colours.paper);
        if (!shot.ready) return;
        const steps = shot.journey();
        paintImage(plan, stage.colours, shot, steps);
        paintFloor(plan, stage.colours, shot);
        paintSide(side, stage.colours, shot, steps);
        story.innerHTML = tell(steps, shot);
      },
      describe: () => (shot.ready ? sentence(shot.journey()) : "The image is being unpacked."),
    };
  });

  /** The colour image, with a green veil on what counts as floor. */
  function paintImage(plan, colours, shot, steps) {
    const {context} = plan, size = EVERY * plan.scale;
    context.drawImage(shot.picture, 0, 0, plan.width, plan.height);
    context.fillStyle = colours.clear;
    context.globalAlpha = 0.35;
    for (const [u, v, ...point] of shot.few) {
      if (Math.abs(shot.body(point)[2]) <= shot.settings.tolerance) context.fillRect(u * plan.scale - size / 2, v * plan.scale - size / 2, size, size);
    }
    context.globalAlpha = 1;
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

  /** In the upper right corner, from above with the robot below: the floor that the chosen pixels have painted. */
  function paintFloor(plan, colours, shot) {
    const {context} = plan, scale = Math.min(150, 0.3 * plan.width) / (2 * FLOOR.half);
    const [left, top, wide, high] = [plan.width - 8 - 2 * FLOOR.half * scale, 8, 2 * FLOOR.half * scale, FLOOR.far * scale];
    context.fillStyle = colours.paper;
    context.fillRect(left, top, wide, high);
    for (const [cell, colour] of shot.painted) {
      const [ix, iy] = cell.split(",").map(Number), x = ix * FLOOR.side, y = iy * FLOOR.side;
      if (x < 0 || x >= FLOOR.far - FLOOR.side || Math.abs(y) > FLOOR.half - FLOOR.side) continue;
      context.fillStyle = colour;
      context.fillRect(left + (FLOOR.half - y - FLOOR.side) * scale, top + high - (x + FLOOR.side) * scale, FLOOR.side * scale + 0.7, FLOOR.side * scale + 0.7);
    }
    context.fillStyle = colours.estimate;
    context.fillRect(left + FLOOR.half * scale - 4, top + high - 6, 8, 6);
    draw.text(plan, "your floor, from above", left + wide, top + high + 16, "#ffffff", {size: 13, align: "right", halo: "#1b1b1b"});
  }

  /** All points from the side: floor in green. The ray of the pixel goes from the camera to its point. */
  function paintSide(side, colours, shot, steps) {
    const at = (x, z) => [((x - SIDE.x0) / (SIDE.x1 - SIDE.x0)) * side.width, ((SIDE.z1 - z) / (SIDE.z1 - SIDE.z0)) * side.height];
    const {context} = side, [px, , pz] = shot.camera.position, {tolerance} = shot.settings;
    for (const [, , ...point] of shot.few) {
      const [x, , z] = shot.body(point), [a, b] = at(x, z);
      context.fillStyle = Math.abs(z) <= tolerance ? colours.clear : colours.muted;
      context.fillRect(a - 1, b - 1, 2, 2);
    }
    const line = (x0, z0, x1, z1, colour, width) => {
      Object.assign(context, {strokeStyle: colour, lineWidth: width});
      context.beginPath();
      context.moveTo(...at(x0, z0));
      context.lineTo(...at(x1, z1));
      context.stroke();
    };
    line(SIDE.x0, tolerance, SIDE.x1, tolerance, colours.ink, 0.75);
    line(SIDE.x0, -tolerance, SIDE.x1, -tolerance, colours.ink, 0.75);
    draw.text(side, "from the side: 8 m of floor, the camera at the left", 8, 18, colours.ink);
    const [cx, cy] = at(px, pz);
    context.fillStyle = colours.estimate;
    context.fillRect(cx - 5, cy - 5, 10, 10);
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
    const {width, height} = shot.camera, [u, v] = colour.map(Math.round);
    const k = 4 * (Math.max(0, Math.min(height - 1, v)) * width + Math.max(0, Math.min(width - 1, u)));
    return `rgb(${shot.colours.slice(k, k + 3).join(",")})`;
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

  function sentence({u, v, depth, body, cell, end}) {
    const place = body ? `its point is ${depth.toFixed(2)} metres deep and ${(100 * body[2]).toFixed(1)} centimetres above the floor` : "";
    return `Pixel ${u}, ${v}: ${place || end}${cell ? `; it paints cell ${cell[0]}, ${cell[1]}` : place ? `; ${end}` : ""}.`;
  }
})(globalThis);
