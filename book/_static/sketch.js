/* A prediction that is drawn: the reader's curve on the axes of the page's own picture, whose curves are covered until it is kept.
 * `data-sketch` says where the picture has these axes, in shares of its sides from the top left, and what they measure. */
(function () {
  "use strict";
  const COLUMNS = 41, STEPS = 40; // across the axes; of an arrow key from their bottom to their top
  const SVG = "http://www.w3.org/2000/svg";
  const within = (value, most) => Math.min(Math.max(value, 0), most);
  const round = value => Number(value.toPrecision(3));

  function shape(name, attributes) {
    const made = document.createElementNS(SVG, name);
    for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
    return made;
  }

  class Sketch {
    constructor(image) {
      this.image = image;
      this.picture = image.closest("picture");
      this.phone = this.picture.querySelector("source");
      this.heights = Array(COLUMNS).fill(null); // shares of the axes' height from their bottom; null where nothing is drawn
      this.at = 0; // the column that keys move
      this.line = shape("polyline", {"class": "pfslam-stroke"});
      this.paper = shape("svg", {viewBox: "0 0 1 1", preserveAspectRatio: "none", "aria-hidden": "true"});
      this.dot = Object.assign(document.createElement("span"), {className: "pfslam-stroke-end"});
      this.pad = Object.assign(document.createElement("div"), {className: "pfslam-pad"});
      this.pad.append(this.paper, this.dot);
      const frame = Object.assign(document.createElement("div"), {className: "pfslam-sketch"});
      this.picture.replaceWith(frame);
      frame.append(this.picture, this.pad);
      this.lay();
      matchMedia(this.phone.media).addEventListener("change", () => this.lay());
      this.listen();
    }

    /* Lay the pad on the axes, as the picture has them that this window shows. */
    lay() {
      const shown = matchMedia(this.phone.media).matches ? this.phone : this.image;
      const {box, across, up} = JSON.parse(shown.dataset.sketch);
      Object.assign(this, {across, up});
      ["left", "top", "width", "height"].forEach((side, k) => { this.pad.style[side] = `${100 * box[k]}%`; });
      const share = (axis, value) => (value - axis.from) / (axis.to - axis.from);
      const grid = [...across.ticks.map(x => `M${share(across, x)} 0V1`), ...up.ticks.map(y => `M0 ${1 - share(up, y)}H1`)].join("");
      this.paper.replaceChildren(shape("path", {"class": "pfslam-grid", d: grid}), this.line);
    }

    /* Cover the curves and take the reader's, or show both. */
    cover(on) {
      const {pad, picture} = this, slider = {
        role: "slider", tabindex: "0", "aria-orientation": "vertical", "aria-valuemin": this.up.from, "aria-valuemax": this.up.to,
        "aria-label": `Your curve: ${this.up.name} over ${this.across.name}. Left and right choose a place, up and down draw there.`,
      };
      picture.inert = on; // it would tell the result, read aloud or at its full size
      pad.classList.toggle("pfslam-asks", on);
      for (const [key, value] of Object.entries(slider)) on ? pad.setAttribute(key, value) : pad.removeAttribute(key);
      if (!on) ["aria-valuenow", "aria-valuetext"].forEach(key => pad.removeAttribute(key));
      this.draw();
    }

    /* The columns where something is drawn. */
    get drawn() { return [...this.heights.keys()].filter(k => this.heights[k] !== null); }

    /* The height of the line above a column, between what is drawn on both sides of it; in the middle without any. */
    between(column) {
      const {drawn} = this, before = drawn.findLast(k => k <= column) ?? drawn[0], after = drawn.find(k => k >= column) ?? before;
      if (before === undefined) return 0.5;
      const share = after > before ? (column - before) / (after - before) : 0;
      return (1 - share) * this.heights[before] + share * this.heights[after];
    }

    place(column) { return this.across.from + (column / (COLUMNS - 1)) * (this.across.to - this.across.from); }

    value(height) { return this.up.from + height * (this.up.to - this.up.from); }

    draw() {
      const {heights, at, pad} = this, height = this.between(at);
      this.line.setAttribute("points", this.drawn.map(k => `${k / (COLUMNS - 1)},${1 - heights[k]}`).join(" "));
      Object.assign(this.dot.style, {left: `${(100 * at) / (COLUMNS - 1)}%`, bottom: `${100 * height}%`});
      if (!pad.classList.contains("pfslam-asks")) return;
      const said = heights[at] === null ? "nothing drawn" : `${this.up.name} ${round(this.value(height))}`;
      pad.setAttribute("aria-valuenow", round(this.value(height)));
      pad.setAttribute("aria-valuetext", `${this.across.name} ${round(this.place(at))}: ${said}`);
    }

    /* Draw from where the pointer was to where it is. */
    follow(event) {
      const box = this.pad.getBoundingClientRect(), start = this.at, first = this.heights[start];
      const end = Math.round(within((event.clientX - box.left) / box.width, 1) * (COLUMNS - 1));
      const last = within((box.bottom - event.clientY) / box.height, 1), way = event.type === "pointermove" ? end - start : 0;
      for (let k = 0; k < Math.abs(way); k++) this.heights[start + k * Math.sign(way)] = first + (k / Math.abs(way)) * (last - first);
      this.heights[end] = last;
      this.at = end;
      this.draw();
    }

    /* What a key does: where it goes, or what it draws there. Whether it does something. */
    press(key) {
      const to = {ArrowLeft: this.at - 1, ArrowRight: this.at + 1, PageDown: this.at - 5, PageUp: this.at + 5, Home: 0, End: COLUMNS - 1}[key];
      const height = {ArrowUp: this.between(this.at) + 1 / STEPS, ArrowDown: this.between(this.at) - 1 / STEPS, Delete: null}[key];
      if (to !== undefined) this.at = within(to, COLUMNS - 1);
      else if (height !== undefined) this.heights[this.at] = height === null ? null : within(height, 1);
      else return false;
      this.draw();
      return true;
    }

    listen() {
      const {pad} = this;
      let before = null; // while a pointer draws: what it found
      pad.addEventListener("pointerdown", event => {
        if (!event.isPrimary || event.button) return;
        pad.setPointerCapture(event.pointerId);
        before = this.heights.slice();
        this.follow(event);
      });
      pad.addEventListener("pointermove", event => { if (before && event.isPrimary) this.follow(event); });
      pad.addEventListener("pointerup", () => { before = null; });
      pad.addEventListener("pointercancel", () => {
        if (before) this.heights = before;
        before = null;
        this.draw();
      });
      pad.addEventListener("keydown", event => {
        if (!event.ctrlKey && !event.metaKey && !event.altKey && this.press(event.key)) event.preventDefault();
      });
    }

    /* The curve as text, pairs of what the axes measure; "" if it is no curve yet. */
    read() {
      return this.drawn.length > 1 ? JSON.stringify(this.drawn.map(k => [round(this.place(k)), round(this.value(this.heights[k]))])) : "";
    }

    /* Draw a curve that was read; another text draws nothing. Whether there is one. */
    write(text) {
      let pairs = [];
      try {
        pairs = JSON.parse(text);
      } catch {
        // what was kept before this question asked for a curve
      }
      const share = (axis, value) => within((value - axis.from) / (axis.to - axis.from), 1);
      this.heights.fill(null);
      if (!Array.isArray(pairs) || !pairs.every(Array.isArray)) pairs = [];
      for (const [x, y] of pairs) this.heights[Math.round(share(this.across, x) * (COLUMNS - 1))] = share(this.up, y);
      this.draw();
      return this.read() !== "";
    }
  }

  globalThis.pfslamSketch = image => new Sketch(image);
})();
