/* A run to look at: the page that `pfslam run` leaves in its folder, on the stage of the laboratories.
 *
 * What the run tells stands in the page as JSON, arrays as base64 of their bytes; `pfslam.cli.page` says what there is. A moment
 * is one of the scans that the page holds. Frames: w world, b body. Lengths in metres, times in seconds since the first scan.
 */
(function (root) {
  "use strict";
  const {core, draw, lab, make} = root.pfslam;
  const ARRAYS = {int16: Int16Array, int32: Int32Array, float32: Float32Array};
  const NINE_OF_TEN = 4.605;  // chi-square of two: an ellipse that holds the place nine times of ten
  const MISSING = -32768;  // in the place of a beam that a scan does not have
  const PLAYED = 20, SLOWEST = 6, FASTEST = 40;  // seconds that the whole run lasts; moments a second
  const NEAR = [0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50];  // half widths of the view from near (m)
  const WIDE = 900, LEAST_CLOSE = 300, GAP = 12;  // pixels: from WIDE on the view from near stands beside the map, as in run.html
  const NAMES = {odometry: "odometry", slam: "estimate", revised: "revised"};

  /** What the page holds, with its arrays unpacked. */
  function told() {
    const unpack = (_, value) => {
      if (!value || !ARRAYS[value.type] || !value.data) return value;
      return new ARRAYS[value.type](Uint8Array.from(atob(value.data), letter => letter.charCodeAt(0)).buffer);
    };
    return JSON.parse(document.getElementById("run").textContent, unpack);
  }

  /** A map that grows with the moments: cells in the order in which they were first seen, so that only what changes is painted. */
  class Growth {
    constructor({image, extent}, count, ready) {
      Object.assign(this, {extent, store: document.createElement("canvas"), shown: -1, picture: new Image()});
      this.picture.onload = () => { this.read(count); ready(); };
      this.picture.src = image;
    }

    read(count) {
      const {store, picture: {width, height}} = this;
      Object.assign(store, {width, height});
      this.context = store.getContext("2d", {willReadFrequently: true});
      this.context.drawImage(this.picture, 0, 0);
      const {data} = this.context.getImageData(0, 0, width, height), n = width * height;
      const seen = new Uint16Array(n);
      this.kinds = new Uint8Array(n);
      this.first = new Uint32Array(count + 1);  // first[k] cells were seen before moment k
      for (let c = 0; c < n; c++) {
        seen[c] = 256 * data[4 * c] + data[4 * c + 1];
        this.kinds[c] = data[4 * c + 2] / 100;
        if (this.kinds[c]) this.first[seen[c] + 1] += 1;
      }
      for (let k = 0; k < count; k++) this.first[k + 1] += this.first[k];
      const next = this.first.slice();
      this.order = new Uint32Array(this.first[count]);
      for (let c = 0; c < n; c++) if (this.kinds[c]) this.order[next[seen[c]]++] = c;
      this.pixels = this.context.createImageData(width, height);
    }

    /** The canvas with the map as it was known at moment k. */
    at(k, colours) {
      const {first, order, kinds, pixels} = this;
      if (this.colours !== colours) Object.assign(this, {colours, shown: -1, paint: [[0, 0, 0, 0], rgb(colours.free), rgb(colours.wall)]});
      if (this.shown === k) return this.store;
      if (this.shown < 0) for (let c = 0; c < kinds.length; c++) this.dot(c, 0);
      const [from, to] = [first[this.shown + 1], first[k + 1]];
      for (let o = from; o < to; o++) this.dot(order[o], kinds[order[o]]);
      for (let o = to; o < from; o++) this.dot(order[o], 0);
      this.context.putImageData(pixels, 0, 0);
      this.shown = k;
      return this.store;
    }

    dot(c, kind) {
      const {pixels: {data}, paint} = this;
      data.set(paint[kind], 4 * c);
    }
  }

  function rgb(colour) { return [...[1, 3, 5].map(k => parseInt(colour.slice(k, k + 2), 16)), 255]; }

  /** A run, and the moment of it that is shown. */
  class Run {
    constructor(ready) {
      Object.assign(this, told());
      const {maps, t, paths, floor} = this;
      this.last = t.length - 1;
      this.at = this.last;
      this.main = paths.estimate ? "estimate" : "odometry";
      this.revised = Boolean(paths.revised);
      this.growths = Object.fromEntries(Object.entries(maps || {}).map(([name, map]) => [name, new Growth(map, t.length, ready)]));
      this.places = Object.fromEntries(Object.entries(paths).map(([name, poses]) => [name, poses.filter((_, k) => k % 3 < 2)]));
      if (floor) {
        this.carpet = new Image();
        this.carpet.onload = ready;
        this.carpet.src = floor.image;
      }
      this.doubts = Array.from(t, when => this.distrust.filter(d => when >= d.from && when <= (d.to ?? Infinity)));
    }

    /** The name of the path that is shown: revised or as the filter had it. */
    get shown() { return this.revised ? "revised" : this.main; }

    get growth() { return this.growths[this.revised ? "revised" : "estimate"]; }

    pose(name = this.shown, k = this.at) { return this.paths[name].slice(3 * k, 3 * k + 3); }

    get doubt() { return this.doubts[this.at]; }

    /** Metres from the truth, where it is known. */
    error(name) {
      if (!this.paths.truth || !this.paths[name]) return NaN;
      const [x, y] = this.pose(name), [tx, ty] = this.pose("truth");
      return Math.hypot(x - tx, y - ty);
    }

    /** The scan's end points in the world, x, y, x, y, ... */
    get points() {
      if (!this.scan) return new Float64Array(0);
      const size = this.scan.length / this.t.length, points = this.scan.subarray(size * this.at, size * (this.at + 1));
      return core.transformPoints(this.pose(), Float64Array.from(points.filter(value => value !== MISSING), value => value / 100));
    }

    /** The cloud as poses x, y, theta, as the stage draws them. */
    get particlesNow() {
      const size = this.cloud.length / this.t.length, near = this.cloud.subarray(size * this.at, size * (this.at + 1));
      const [x, y, theta] = this.pose("estimate"), poses = new Float64Array(1.5 * size);
      for (let k = 0; k < size / 2; k++) poses.set([x + near[2 * k] / 1000, y + near[2 * k + 1] / 1000, theta], 3 * k);
      return poses;
    }

    /** Half axes (m) and angle of the covariance's ellipse, or null. */
    get ellipse() {
      if (!this.covariance || this.revised) return null;
      const [xx, xy, yy] = this.covariance.subarray(3 * this.at, 3 * this.at + 3), middle = (xx + yy) / 2;
      const apart = Math.hypot((xx - yy) / 2, xy), axis = value => Math.sqrt(NINE_OF_TEN * Math.max(value, 0));
      return {long: axis(middle + apart), short: axis(middle - apart), angle: 0.5 * Math.atan2(2 * xy, xx - yy)};
    }

    /** The moment whose pose is nearest to a place; of equals the one nearest in time. */
    nearest(x, y) {
      const places = this.places[this.shown];
      let best = this.at, least = Infinity;
      for (let k = 0; k <= this.last; k++) {
        const far = Math.hypot(places[2 * k] - x, places[2 * k + 1] - y) + 0.2 * Math.abs(k - this.at) / (this.last + 1);
        if (far < least) [best, least] = [k, far];
      }
      return best;
    }

    /** What all maps and paths cover: x0, x1, y0, y1, with half a metre around. */
    get window() {
      const box = [Infinity, -Infinity, Infinity, -Infinity];
      const add = (x, y) => {
        if (!Number.isFinite(x + y)) return;
        box.splice(0, 4, Math.min(box[0], x), Math.max(box[1], x), Math.min(box[2], y), Math.max(box[3], y));
      };
      for (const [name, places] of Object.entries(this.places)) {
        if (name === "odometry" && this.maps) continue;  // it may drift far away
        for (let k = 0; k < places.length; k += 2) add(places[k], places[k + 1]);
      }
      for (let k = 0; k <= this.last && this.scan; k++) {
        const size = this.scan.length / this.t.length, [x, y, theta] = this.pose(this.shown, k), [c, s] = [Math.cos(theta), Math.sin(theta)];
        for (let b = size * k; b < size * (k + 1) && this.scan[b] !== MISSING; b += 8) {
          const [px, py] = [this.scan[b] / 100, this.scan[b + 1] / 100];
          add(x + c * px - s * py, y + s * px + c * py);
        }
      }
      const [x0, x1, y0, y1] = box, short = Math.max(0, 0.45 * (x1 - x0) - (y1 - y0)) / 2;  // no strip that is too flat to read
      return [x0 - 0.5, x1 + 0.5, y0 - 0.5 - short, y1 + 0.5 + short];
    }
  }

  lab("run", stage => {
    const run = new Run(() => stage.redraw()), shown = {floor: true, rays: true, story: ""};
    const {body, buttons, controls, figure} = stage;
    controls.after(buttons);  // as on a player: what turns the picture stands under it
    const plan = stage.plan({
      name: "The map and the robot",
      help: "Tap the map or the time line, or drag along them. Keys on the map: space plays, the arrows go one moment back or on, " +
        "Page Up and Page Down ten, Home and End to the ends.",
      window: run.window,
    });
    const close = run.maps ? stage.plan({name: "The robot from near", window: [-1, 1, -1, 1]}) : null;
    const beside = () => (close && root.innerWidth >= WIDE ? LEAST_CLOSE + GAP : 0);
    body.classList.toggle("pfslam-two", Boolean(close));
    plan.widest = () => Math.min(body.clientWidth - beside(), (0.66 * root.innerHeight) / plan.aspect(1));
    if (close) {
      close.widest = () => (beside() ? Math.max(LEAST_CLOSE, Math.min(body.clientWidth - plan.width - GAP, plan.height)) : 240);
    }
    const time = run.maps ? stage.chart({name: "Effective particles and departure from odometry over time", height: 128}) : null;
    const story = stage.words(""), slider = stage.slider({
      name: "Moment", min: 1, max: run.last + 1, step: 1, value: run.at + 1, digits: 0, change: value => go(value - 1)});
    story.classList.add("pfslam-story");
    stage.words(legend(run));

    function go(k) {
      run.at = Math.max(0, Math.min(run.last, Math.round(k)));
      if (Number(slider.value) !== run.at + 1) {
        slider.value = run.at + 1;
        slider.dispatchEvent(new Event("input"));
      }
      stage.redraw();
    }
    const on = () => go(run.at < run.last ? run.at + 1 : 0);
    const clock = stage.clock({
      hertz: Math.max(SLOWEST, Math.min(FASTEST, run.last / PLAYED)), step: on,
      tick() {
        on();
        if (run.at === run.last) clock.pause();
      },
    });
    const byHand = k => { clock.pause(); go(k); };
    const floor = run.floor && stage.check({name: "Floor, as at the end", key: "f", value: true, change: value => { shown.floor = value; }});
    if (run.maps) stage.check({name: "Scan", key: "s", value: true, change: value => { shown.rays = value; }});
    if (run.paths.revised) stage.check({name: "Revised path", key: "l", value: true, change: value => {
      run.revised = value;
      if (floor) floor.disabled = value;  // it was painted along the filter's path
    }});
    if (floor) floor.disabled = run.revised;
    stage.drag(plan, {start: (x, y) => byHand(run.nearest(x, y)), move: (x, y) => byHand(run.nearest(x, y))});
    if (time) scrub(time, share => byHand(momentAt(run, share)));
    const by = step => down => { if (down) byHand(run.at + step); };
    stage.keys(plan, {ArrowLeft: by(-1), ArrowRight: by(1), PageUp: by(-10), PageDown: by(10), Home: by(-Infinity), End: by(Infinity)});
    document.body.addEventListener("keydown", event => {  // before anything has the focus, the map takes the first key
      if (event.target !== document.body || ![" ", "ArrowLeft", "ArrowRight"].includes(event.key)) return;
      event.preventDefault();
      plan.holder.focus({preventScroll: true});
      plan.holder.dispatchEvent(new KeyboardEvent("keydown", {key: event.key, bubbles: true}));
    });
    figure.before(...verdict(run, t => { byHand(momentAt(run, t / run.t[run.last])); plan.holder.focus(); }));
    figure.after(...facts(run));
    return {
      state: run, shown,
      draw() {
        paint(plan, stage, run, shown, false);
        if (close) paintClose(close, stage, run, shown);
        if (time) paintTime(time, stage, run);
        const words = sentence(run);
        if (words !== shown.story) story.textContent = shown.story = words;
      },
      describe: () => sentence(run),
    };
  });

  /** Mouse, pen and finger along a time line; `go` gets the share of the time. */
  function scrub(chart, go) {
    const {canvas} = chart, held = new Set();
    Object.assign(canvas.style, {touchAction: "pan-y pinch-zoom", cursor: "ew-resize"});
    const move = event => go((event.offsetX - chart.left) / (chart.width - chart.left - chart.right));
    canvas.addEventListener("pointerdown", event => {
      if (event.button !== 0) return;
      held.add(event.pointerId);
      canvas.setPointerCapture(event.pointerId);
      move(event);
    });
    canvas.addEventListener("pointermove", event => { if (held.has(event.pointerId)) move(event); });
    for (const kind of ["pointerup", "pointercancel"]) canvas.addEventListener(kind, event => held.delete(event.pointerId));
  }

  /** The last moment at a share of the time. */
  function momentAt({t, last}, share) {
    const when = Math.max(0, Math.min(1, share)) * t[last] + 1e-6;
    let [low, high] = [0, last];
    while (low < high) {
      const middle = Math.ceil((low + high) / 2);
      if (t[middle] <= when) low = middle;
      else high = middle - 1;
    }
    return low;
  }

  /** The map of the moment with paths and scan; unless it is seen from `near`, with floor, doubts, robot and words, too. */
  function paint(plan, stage, run, shown, near) {
    const {colours} = stage, {at, paths, places, growth} = run, {context} = plan, thin = near ? 1.5 : 2;
    context.clearRect(0, 0, plan.width + 1, plan.height + 1);
    const picture = (image, [x0, x1, y0, y1]) => {
      const [left, top] = plan.at(x0, y1), [right, bottom] = plan.at(x1, y0);
      context.imageSmoothingEnabled = right - left < image.width;  // made smaller, thin walls must not fall between pixels
      context.drawImage(image, left, top, right - left, bottom - top);
    };
    if (growth && growth.order) picture(growth.at(at, colours), growth.extent);
    if (run.carpet && run.carpet.complete && shown.floor && !run.revised && !near) {
      context.globalCompositeOperation = "source-atop";  // floor only where the map is known at this moment
      picture(run.carpet, run.floor.extent);
    }
    context.globalCompositeOperation = "destination-over";
    plan.clear(colours.paper);
    context.globalCompositeOperation = "source-over";
    for (const {from, to} of near ? [] : run.distrust) {
      const [a, b] = [run.t.findIndex(t => t >= from - 1e-3), to === null ? at : Math.min(at, momentAt(run, to / run.t[run.last]))];
      if (a < 0 || b < a) continue;
      context.globalAlpha = 0.5;
      draw.line(plan, places[run.shown].subarray(2 * a, 2 * b + 2), colours.highlight, {width: 9});
      context.globalAlpha = 1;
    }
    const path = (name, colour, look) => {
      if (places[name]) draw.line(plan, places[name].subarray(0, 2 * at + 2), colour, look);
    };
    const points = run.points, pose = run.pose();
    if (shown.rays && points.length) {
      if (!near) draw.rays(plan, pose.slice(0, 2), points, colours.clear);
      draw.dots(plan, points, colours.hits, near ? 2 : 1.4);
    }
    path("odometry", colours.odometry, {width: thin, dash: [6, 5]});
    path("truth", colours.truth, {width: thin, dash: [2, 3]});
    if (run.revised) path("estimate", colours.muted, {width: 1.5});
    if (paths.estimate) path(run.shown, colours.estimate, {width: thin + 0.5});
    if (run.loops) paintLoops(plan, colours, run);
    if (near) return;
    draw.robot(plan, pose, paths.estimate ? colours.estimate : colours.odometry, {radius: Math.max(0.22, 6 / plan.scale), fill: colours.free});
    const size = plan.width < 500 ? 13 : 15, words = run.doubt.length ? "not to be trusted" : "";
    draw.text(plan, `${clockTime(run.t[at])}`, 8, 1.4 * size, colours.ink, {size, halo: colours.paper});
    draw.text(plan, words, plan.width - 8, 1.4 * size, colours.ink, {size, align: "right", halo: colours.highlight});
  }

  /** Pairs of places that were found to be the same, once both have been seen. */
  function paintLoops(plan, colours, {loops, numbers, at, places, shown}) {
    const ends = [];
    const place = scan => {
      const k = numbers.findIndex(number => number >= scan);
      return places[shown].subarray(2 * k, 2 * k + 2);
    };
    for (let pair = 0; pair < loops.length; pair += 2) {
      if (loops[pair + 1] <= numbers[at]) ends.push(...place(loops[pair]), ...place(loops[pair + 1]));
    }
    draw.line(plan, ends, colours.clear, {width: 2, gaps: true});
    draw.dots(plan, ends, colours.clear, 3);
  }

  /** The cloud and the ellipse, in a window about the robot that follows their size. */
  function paintClose(plan, stage, run, shown) {
    const {colours} = stage, {ellipse, revised} = run, [x, y, theta] = run.pose(), {context} = plan;
    const poses = run.particlesNow, far = [0.05, ellipse ? 1.5 * ellipse.long : 0];
    for (let k = 0; k < poses.length && !revised; k += 3) far.push(1.2 * Math.hypot(poses[k] - x, poses[k + 1] - y));
    const half = NEAR.find(size => size >= Math.max(...far)) || NEAR[NEAR.length - 1];
    plan.window = [x - half, x + half, y - half, y + half];
    paint(plan, stage, run, shown, true);
    if (!revised) {
      draw.particles(plan, poses, new Float64Array(poses.length / 3).fill(3 / poses.length), colours, {radius: 2.2});
      if (ellipse) {
        context.beginPath();
        context.ellipse(...plan.at(x, y), ellipse.long * plan.scale, ellipse.short * plan.scale, -ellipse.angle, 0, 2 * Math.PI);
        Object.assign(context, {strokeStyle: colours.estimate, lineWidth: 2});
        context.stroke();
      }
    }
    draw.line(plan, [x, y, x + 0.5 * half * Math.cos(theta), y + 0.5 * half * Math.sin(theta)], colours.estimate, {width: 2.5});
    if (Number.isFinite(run.error(run.shown))) draw.dots(plan, run.pose("truth").slice(0, 2), colours.truth, 4);
    const bar = half / 2, left = 10, low = plan.height - 12;
    Object.assign(context, {strokeStyle: colours.ink, lineWidth: 2});
    context.beginPath();
    context.moveTo(left, low);
    context.lineTo(left + bar * plan.scale, low);
    context.stroke();
    draw.text(plan, bar < 1 ? `${Math.round(100 * bar)} cm` : `${bar} m`, left, low - 6, colours.ink, {size: 13, halo: colours.paper});
  }

  /** Two curves over time, the stretches that are not to be trusted, and the moment. */
  function paintTime(chart, {colours}, run) {
    const {context, width, height} = chart, {t, last, at, effective, departure, particles, improbable} = run;
    const middle = height / 2 - 8, foot = 20, many = particles > 1, top = many ? middle + 6 : 4;
    Object.assign(chart, {left: 8, right: 8});
    const x = when => chart.left + ((width - chart.left - chart.right) * when) / (t[last] || 1);
    chart.clear(colours.sheet);
    context.globalAlpha = 0.45;
    context.fillStyle = colours.highlight;
    for (const {from, to} of run.distrust) context.fillRect(x(from), 0, Math.max(3, x(to ?? t[last]) - x(from)), height - foot);
    context.globalAlpha = 1;
    const curve = (values, y, colour) => {
      context.beginPath();
      values.forEach((value, k) => context.lineTo(x(t[k]), y(value)));
      Object.assign(context, {strokeStyle: colour, lineWidth: 1.5, lineJoin: "round"});
      context.stroke();
    };
    const most = Math.max(...improbable, ...departure), y = value => height - foot - ((height - foot - top - 4) * value) / most;
    if (many) curve(effective, value => middle - ((middle - 6) * value) / particles, colours.estimate);
    context.setLineDash([4, 4]);
    curve(improbable, y, colours.muted);
    context.setLineDash([]);
    curve(departure, y, colours.odometry);
    Object.assign(context, {strokeStyle: colours.ink, lineWidth: 2});
    context.beginPath();
    context.moveTo(x(t[at]), 0);
    context.lineTo(x(t[at]), height - foot);
    context.stroke();
    const write = (words, px, py, align = "left") => draw.text(chart, words, px, py, colours.ink, {size: 12, align, halo: colours.sheet});
    if (many) write(`effective particles, of ${particles}`, 12, middle - 4);
    write(`moved by scans in 2 s: at most ${(100 * Math.max(...departure)).toFixed(0)} cm`, 12, top + 12);
    write("0:00", 8, height - 5);
    write(clockTime(t[last]), width - 8, height - 5, "right");
    const here = x(t[at]);
    if (here > 60 && here < width - 60) write(clockTime(t[at]), here, height - 5, "center");
  }

  function clockTime(seconds) { return `${Math.floor(seconds / 60)}:${(seconds % 60).toFixed(1).padStart(4, "0")}`; }

  function metres(value) { return value < 1 ? `${(100 * value).toFixed(value < 0.1 ? 1 : 0)} cm` : `${value.toFixed(2)} m`; }

  /** The moment in words. */
  function sentence(run) {
    const {at, numbers, scans, effective, particles, doubt} = run, words = [`${clockTime(run.t[at])}, scan ${numbers[at] + 1} of ${scans}.`];
    const [from, wheels] = [run.error(run.shown), run.error("odometry")];
    if (run.maps && Number.isFinite(from)) words.push(`The ${run.revised ? "revised path" : "estimate"} is ${metres(from)} from the truth, odometry ${metres(wheels)}.`);
    else if (Number.isFinite(wheels)) words.push(`Odometry is ${metres(wheels)} from the truth.`);
    if (run.maps && particles > 1) words.push(`${Math.round(effective[at])} of ${particles} particles carry the weight.`);
    if (run.loops && run.loops.length && run.revised) words.push(`Loops closed so far: ${Array.from(run.loops).filter((scan, k) => k % 2 && scan <= numbers[at]).length}.`);
    for (const {reason} of doubt) words.push(`Not to be trusted: ${reason}.`);
    return words.join(" ");
  }

  /** What the colours mean: HTML of our own. */
  function legend({paths, cloud, distrust, loops}) {
    const dot = (colour, words) => `<span class="pfslam-dot" aria-hidden="true" style="color:var(--lab-${colour})">●</span>\u00a0${words}`;
    return [
      paths.estimate && dot("estimate", "estimate"), dot("odometry", "odometry (dashed)"), paths.truth && dot("truth", "truth (dotted)"),
      cloud && dot("particles", "particles"), cloud && dot("hits", "ends of beams"), cloud && "○\u00a0ellipse: nine times of ten",
      loops && loops.length && dot("clear", "places found to be the same"), distrust.length && dot("highlight", "not to be trusted"),
    ].filter(Boolean).join(" &ensp;");
  }

  /** Whether the run is to be trusted, in words that lead to the moments. */
  function verdict({about, distrust, maps}, go) {
    const failed = about.checks_failed.length ? " Checks of the data set failed, though: they stand below." : "";
    if (!maps) return [make("p", {text: "No LiDAR in this data set: this is the path of the odometry alone, without a map."})];
    if (!distrust.length) return [make("p", {text: `The run saw no reason to distrust itself.${failed}`})];
    return distrust.map(({from, to, reason}) => {
      const button = make("button", {type: "button", text: to === null ? `From ${clockTime(from)} on` : `From ${clockTime(from)} to ${clockTime(to)}`});
      button.addEventListener("click", () => go(from));
      return make("p", {class: "doubt"}, make("strong", {text: "Do not trust path and map. "}), button, `: ${reason}.`);
    });
  }

  /** Errors where the truth is known, and how the run was made. */
  function facts({about, t, scans, maps, numbers}) {
    const parts = [], known = Object.keys(NAMES).filter(name => about[name]);
    if (known.length) {
      const row = (kind, ...cells) => make("tr", {}, ...cells.map((text, k) => make(k ? kind : "th", {text, scope: k && kind === "td" ? undefined : k ? "col" : "row"})));
      const rows = known.map(name => row("td", NAMES[name], ...["ate_rmse_m", "ate_max_m", "heading_rmse_deg"].map(key => about[name][key].toFixed(3))));
      parts.push(make("h2", {text: "Error from the truth"}), make("table", {},
        make("thead", {}, row("th", "path", "root mean square, m", "largest, m", "heading, deg")), make("tbody", {}, ...rows)));
    }
    const list = make("dl");
    const fact = (name, ...lines) => {
      if (lines.length) list.append(make("dt", {text: name}), make("dd", {}, ...lines.map(line => (line instanceof Node ? line : make("p", {text: line})))));
    };
    fact("Made by", make("code", {text: about.command}), make("p", {text: `pfslam ${about.version}`}));
    fact("Data set", `${about.dataset}, ${clockTime(t[t.length - 1])} from first to last`);
    if (maps) fact("Filter", `${about.method}, seed ${about.seed}, ${about.config.particles === 1 ? "one particle" : `${about.config.particles} particles`}`);
    if (about.loops) fact("Loops", `${about.loops.accepted} closed; the revision moves the path by at most ${metres(about.loops.largest_move_m)}`);
    fact("Checks failed", ...about.checks_failed.map(check => `${check.question} ${check.found}, expected ${check.expected}`));
    fact("Left out", ...Object.entries(about.dropped).map(([reason, count]) => `${count} ${reason}`));
    fact("Notes", ...about.notes);
    if (numbers.length < scans) fact("On this page", `${numbers.length} of ${scans} scans, evenly spread; where curves are thinned, the worst is kept`);
    return [...parts, make("h2", {text: "How it was made"}), list];
  }
})(globalThis);
