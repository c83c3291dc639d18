/* The stage of a laboratory: canvases, controls, a clock, and how things of the book are drawn.
 *
 * A laboratory is a file of its own that calls `pfslam.lab(name, build)`. For every `<figure class="pfslam-lab"
 * data-lab="name" data-options="{...}">` of the page, `build(stage)` puts the parts on the stage and returns
 * {draw(), describe()} and what else it wants to be found at `figure.lab`: its state, for instance.
 *
 *   const plan = stage.plan({name: "Map", window: [x0, x1, y0, y1]});      metres; plan.at(x, y) is a pixel
 *   const strip = stage.chart({name: "N_eff", height: 70});                pixels; with `help` it takes the focus, as a plan does
 *   stage.button({name: "Score", key: "s", press() {...}});
 *   stage.slider({name: "Noise", min: 0, max: 3, step: 0.01, value: 1, unit: "m", digits: 2, change(value) {...}});
 *   stage.choice({name: "Score by", options: {count: "count", field: "likelihood field"}, value: "count", change});
 *   stage.check({name: "Show the truth", key: "t", value: false, change});
 *   stage.clock({hertz: 60, tick() {...}, step() {...}});                  Start and Pause, and Step
 *   stage.drag(plan, {start(x, y), move(x, y), end(cancelled), grab(x, y)});   mouse and finger, in metres
 *   stage.handle(strip, {noise: slider}, (x, y) => ...);                   a thing in a picture that stands for sliders
 *   stage.keys(plan, {ArrowUp(down) {...}});                               while the plan, or a button of its, has the focus
 *   const share = stage.glide(0.6);                                        share() goes from 0 to 1 in so many seconds
 *   plan.write("Sentence.");                                               in the line above the picture, HTML of our own
 *   stage.say("Sentence.");                                                for who listens, once a second at most
 *   stage.fold("More");                                                    what comes after it is folded away
 *   stage.tell("Sentence.");                                               for everybody, until the reader does something
 *   stage.redraw();                                                        before the next frame
 */
(function (root) {
  "use strict";
  const {core} = root.pfslam;
  const calm = () => root.matchMedia("(prefers-reduced-motion: reduce)").matches;
  const TALLEST = {wide: 0.42, narrow: 0.5}, LOWEST = 240;  // so high a plan may be, of the window or in pixels: what turns it is seen with it
  const THINGS = ["wall", "truth", "odometry", "estimate", "particles", "hits", "highlight", "clear", "muted"], PALE = 0.2;  // drawn on the ground
  const SIDEWAYS = 8, FINGER = 26;  // pixels after which a finger drags; pixels within which one takes hold of a thing
  const REACH = 3;  // pixels to each side of a pointer in which it points at a thing
  // In JupyterLab each laboratory loads this file once more: what is known by then must stay.
  const known = (root.pfslam.known = root.pfslam.known || {builders: {}, count: 0});

  /** An element with attributes, `text` and children. */
  function make(tag, attributes = {}, ...children) {
    const element = document.createElement(tag);
    for (const [name, value] of Object.entries(attributes)) {
      if (name === "text") element.textContent = value;
      else if (value !== undefined && value !== false) element.setAttribute(name, value === true ? "" : value);
    }
    element.append(...children);
    return element;
  }

  /** A canvas as sharp as the screen. `context` counts in CSS pixels; `fit()` follows the width that the page gives. */
  class Sheet {
    constructor(canvas, aspect) {
      Object.assign(this, {canvas, aspect, context: canvas.getContext("2d"), width: 0, height: 0});
    }

    fit(across) {
      const ratio = root.devicePixelRatio || 1;
      const width = Math.min(across, this.widest ? this.widest() : across);
      Object.assign(this, {width, height: this.aspect(width)});
      this.canvas.width = Math.round(width * ratio);
      this.canvas.height = Math.round(this.height * ratio);
      Object.assign(this.canvas.style, {width: `${width}px`, height: `${this.height}px`});
      this.context.setTransform(ratio, 0, 0, ratio, 0, 0);
    }

    clear(colour) {
      this.context.fillStyle = colour;
      this.context.fillRect(0, 0, this.width + 1, this.height + 1);  // the last row of pixels may be a part
    }

    /** A sheet without a window counts in pixels. */
    at(x, y) { return [x, y]; }
    world(px, py) { return [px, py]; }

    /** Whether a finger at a place takes hold of a thing at another. */
    near(x, y, thing) {
      const [px, py] = this.at(x, y), [thereX, thereY] = this.at(...thing);
      return Math.hypot(px - thereX, py - thereY) < FINGER;
    }
  }

  /** A sheet with a window on the world, in metres, y upwards, equal scales. */
  class Plan extends Sheet {
    constructor(canvas, window) {
      super(canvas, width => (width * (window[3] - window[2])) / (window[1] - window[0]));
      this.window = window;
    }

    /** So wide it may be for its height to fit in the window. */
    widest() {
      const share = TALLEST[root.innerWidth < root.innerHeight ? "narrow" : "wide"];
      return Math.max(LOWEST, share * root.innerHeight) / this.aspect(1);
    }

    /** Pixels in a metre. */
    get scale() { return this.width / (this.window[1] - this.window[0]); }

    /** The pixel of a point of the world. */
    at(x, y) { return [(x - this.window[0]) * this.scale, (this.window[3] - y) * this.scale]; }

    /** The point of the world under a pixel. */
    world(px, py) { return [this.window[0] + px / this.scale, this.window[3] - py / this.scale]; }
  }

  class Stage {
    constructor(figure, options) {
      const id = `pfslam-lab-${(known.count += 1)}`;
      Object.assign(this, {figure, options, id, sheets: [], shortcuts: {}, said: "", saidAt: -Infinity, visible: null});
      this.settings = [];  // of the controls, as a link has them
      this.help = [];  // what keys and fingers do, which is read once: it is folded with what is needed less
      this.small = Boolean(options.small);
      this.body = make("div", {class: "pfslam-lab-body"});
      this.controls = make("div", {class: "pfslam-settings"});
      this.buttons = make("div", {class: "pfslam-buttons"});
      this.status = make("p", {class: "pfslam-status", role: "status", "aria-live": "polite"});
      // In small the picture comes first: a visitor sees it before anything can be pressed.
      this.body.append(...(this.small ? [this.controls, this.buttons] : [this.buttons, this.controls]), this.status);
      figure.append(this.body);
      figure.classList.add("pfslam-live");
      for (const kind of ["pointerdown", "keydown"]) figure.addEventListener(kind, () => this.tell(""), true);
      figure.addEventListener("keydown", event => this.pressed(event));
      this.readColours();
      const repaint = new MutationObserver(() => { this.readColours(); this.redraw(); });
      for (const place of [document.documentElement, document.body]) {
        repaint.observe(place, {attributes: true, attributeFilter: ["data-theme", "data-jp-theme-light"]});
      }
      new IntersectionObserver(entries => { this.visible = entries[0].isIntersecting; this.redraw(); }).observe(figure);
      new ResizeObserver(() => this.fit()).observe(this.body);
    }

    get calm() { return calm(); }

    /** The palette of the book, from the style sheet: `stage.colours.particles`. It is known only once the figure and the
     * style sheet are on the page, which in JupyterLab may be later than this script. */
    readColours() {
      const style = getComputedStyle(this.figure);
      this.colours = {};
      for (const name of ["paper", "ink", "free", "sheet", "wall", "truth", "odometry", "estimate", "particles", "hits", "highlight",
                          "clear", "muted"]) {
        this.colours[name] = style.getPropertyValue(`--lab-${name}`).trim();
      }
      if (!this.colours.paper || !THINGS.includes(this.lit)) return;
      for (const name of THINGS) if (name !== this.lit) this.colours[name] = paler(this.colours[name], this.colours.free);
    }

    /** Light one thing of the pictures, by the name of its colour: all others become pale. "" lights all alike. */
    light(name) {
      if (name === (this.lit || "")) return;
      this.lit = name;
      this.readColours();
      this.redraw();
    }

    /** Which of the `names` has its colour most often on a canvas round a point of the screen; undefined if none has. */
    under(canvas, {clientX, clientY}, names) {
      const box = canvas.getBoundingClientRect(), scale = canvas.width / box.width, side = Math.ceil(2 * REACH * scale);
      const [left, top] = [(clientX - box.left) * scale, (clientY - box.top) * scale].map(pixel => Math.round(pixel - side / 2));
      const {data} = canvas.getContext("2d").getImageData(left, top, side, side);
      const palette = Object.entries(this.colours).map(([name, colour]) => [name, rgb(colour), 0]);
      for (let at = 0; at < data.length; at += 4) {
        const far = ([, colour]) => colour.reduce((sum, value, k) => sum + (data[at + k] - value) ** 2, 0);
        palette.reduce((nearest, entry) => (far(entry) < far(nearest) ? entry : nearest))[2] += 1;
      }
      const found = palette.filter(([name, , times]) => times && names.includes(name));
      return found.length ? found.reduce((most, entry) => (entry[2] > most[2] ? entry : most))[0] : undefined;
    }

    fit() {
      const width = this.body.clientWidth;
      if (!width || width === this.fitted) return;
      this.fitted = width;
      this.sheets.forEach(sheet => sheet.fit(width));
      this.redraw();
    }

    /** Put a sheet on the stage, with a line of words above it: what is written there, `sheet.write(html)`, hides nothing. */
    place(sheet, element) {
      const line = make("p", {class: "pfslam-line"});
      let written = "";
      sheet.write = html => { if (html !== written) line.innerHTML = written = html; };
      this.sheets.push(sheet);
      this.controls.before(line, element);
      return sheet;
    }

    /** A plan that takes the focus; `help` says what keys and fingers do. */
    plan({name, help = "", window}) {
      const plan = this.focused(new Plan(make("canvas", {role: "img", "aria-label": name}), window), name, help);
      if (this.small) plan.widest = () => Infinity;
      return plan;
    }

    /** A strip across the laboratory of `height` pixels, a number or a function of the width. With `help` it takes the focus. */
    chart({name, height, help = ""}) {
      const canvas = make("canvas", {role: "img", "aria-label": name});
      const sheet = new Sheet(canvas, typeof height === "number" ? () => height : height);
      return help ? this.focused(sheet, name, help, "pfslam-plan pfslam-chart") : this.place(sheet, canvas);
    }

    /** Put a sheet on the stage that mouse, finger and keys move something in. */
    focused(sheet, name, help, kind = "pfslam-plan") {
      const helpId = `${this.id}-help-${this.sheets.length}`, words = make("p", {class: "pfslam-note", id: helpId, text: help});
      sheet.holder = make("div", {class: kind, tabindex: "0", role: "application", "aria-label": name, "aria-describedby": helpId}, sheet.canvas);
      sheet.canvas.style.touchAction = "pan-y pinch-zoom";
      this.help.push(words);
      if (this.box) this.box.append(words);
      else this.status.before(words);
      return this.place(sheet, sheet.holder);
    }

    /** A line of words under the pictures, HTML of our own. */
    words(html) {
      const line = make("p", {class: "pfslam-legend"});
      line.innerHTML = html;
      this.controls.before(line);
      return line;
    }

    /** What comes from now on lies folded under these words. */
    fold(words) {
      this.buttons = make("div", {class: "pfslam-buttons"});
      this.controls = make("div", {class: "pfslam-settings"});
      this.box = make("details", {class: "pfslam-more"}, make("summary", {text: words}), this.controls, this.buttons, ...this.help);
      this.status.before(this.box);
    }

    button({name, key, press}) {
      const button = make("button", {type: "button", text: name, "aria-keyshortcuts": key});
      if (key) button.append(" ", make("kbd", {text: key.toUpperCase(), "aria-hidden": "true"}));
      button.addEventListener("click", () => { press(); this.redraw(); });
      if (key) this.shortcuts[key] = () => button.click();
      this.buttons.append(button);
      return button;
    }

    slider({name, min, max, step, value, unit = "", digits = 2, change}) {
      const id = `${this.id}-${name.replace(/\W+/g, "-").toLowerCase()}`;
      const input = make("input", {type: "range", id, min, max, step, value, autocomplete: "off"});
      const output = make("output", {for: id});
      const write = () => {
        output.textContent = `${Number(input.value).toFixed(digits)} ${unit}`.trim();
        input.setAttribute("aria-valuetext", output.textContent);
      };
      input.value = value;
      input.addEventListener("input", () => { write(); change(Number(input.value)); this.redraw(); });
      this.scrolledOver(input);
      write();
      this.setting(name, () => input.value, text => text.trim() !== "" && Number(text) >= min && Number(text) <= max, text => {
        input.value = text;
        input.dispatchEvent(new Event("input"));
      });
      this.controls.append(make("div", {class: "pfslam-slider"}, make("label", {for: id, text: name}), output, input));
      return input;
    }

    /** A finger that scrolls the page across a slider leaves it where it was. */
    scrolledOver(input) {
      let before = input.value;
      input.addEventListener("pointerdown", () => { before = input.value; });
      input.addEventListener("pointercancel", () => {
        if (input.value === before) return;
        input.value = before;
        input.dispatchEvent(new Event("input"));
      });
    }

    choice({name, options, value, change}) {
      const group = `${this.id}-${name.replace(/\W+/g, "-").toLowerCase()}`;
      const set = make("fieldset", {id: group}, make("legend", {text: name}));
      for (const [key, words] of Object.entries(options)) {
        const radio = make("input", {type: "radio", name: group, value: key, autocomplete: "off"});
        radio.checked = key === value;
        radio.addEventListener("change", () => { change(key); this.redraw(); });
        set.append(make("label", {}, radio, ` ${words}`));
      }
      const radios = [...set.querySelectorAll("input")], named = key => radios.find(radio => radio.value === key);
      this.setting(name, () => radios.find(radio => radio.checked).value, named, key => named(key).click());
      this.controls.append(set);
      return set;
    }

    check({name, key, value = false, change}) {
      const box = make("input", {type: "checkbox", autocomplete: "off", "aria-keyshortcuts": key});
      const label = make("label", {class: "pfslam-check"}, box, ` ${name} `);
      if (key) label.append(make("kbd", {text: key.toUpperCase(), "aria-hidden": "true"}));
      box.checked = value;
      box.addEventListener("change", () => { change(box.checked); this.redraw(); });
      this.setting(name, () => (box.checked ? "1" : "0"), text => /^[01]$/.test(text), () => box.click());
      if (key) this.shortcuts[key] = () => box.click();
      this.buttons.append(label);
      return box;
    }

    /** What a link can hold: the value of a control, as a text. What `fits` can be written. */
    setting(name, read, fits, write) {
      this.settings.push({key: name.replace(/\W+/g, "-").toLowerCase(), read, fits, write});
    }

    /** Set the laboratory as a link asks ({key: text} or null), and offer a link to the page with the laboratory as it is. */
    linked(label, asked) {
      const {settings, parts: {state = {}}} = this, chance = state.settings || state;
      if (chance.seed !== undefined) this.setting("seed", () => `${chance.seed}`, isSeed, () => {});  // before it is built
      settings.forEach(one => { one.usual = asked && one.key === "seed" ? "" : one.read(); });
      if (asked) this.set(asked);
      this.label = label;
      if (this.small) return;  // it has a button of its own
      if (!this.box) this.fold("More");
      this.button({name: "Link", press: () => {
        this.copyLink().then(() => this.tell("Copied: a link to this page with these settings."),
                             () => this.tell("The address of this page is now a link to these settings."));
      }});
    }

    /** Make the page's address a link to the laboratory as it is, and copy it. The promise fails where nothing can be copied. */
    copyLink() {
      const changed = this.settings.filter(one => one.read() !== one.usual).map(one => [one.key, one.read()]);
      root.history.replaceState(null, "", `#${new URLSearchParams([["lab", this.label], ...changed])}`);
      return root.navigator.clipboard ? root.navigator.clipboard.writeText(root.location.href) : Promise.reject();
    }

    /** Set every control as a link asks, or as usual, and say what cannot be. One control may set another back: after three
     * rounds all stand. */
    set(asked) {
      const {settings} = this, possible = ({key, fits}) => key in asked && fits(asked[key]);
      for (let round = 0; round < 3; round++) {
        for (const one of settings) {
          const value = possible(one) ? asked[one.key] : one.usual;
          if (one.read() !== value) one.write(value);
        }
      }
      const refused = settings.filter(one => one.key in asked && !possible(one)).map(one => one.key);
      if (Object.keys(asked).some(key => !settings.some(one => one.key === key))) refused.push("something unknown");
      if (refused.length) this.tell(`The link asks for what cannot be here, so it is as usual: ${refused.join(", ")}.`);
    }

    /** Start and Pause, or other `names`, of a clock that ticks `hertz` times a second, and Step; in small one of the two.
     * Who asked for less motion steps. */
    clock({hertz, tick, step, names: [go, stop] = ["Start", "Pause"]}) {
      const clock = {running: false, hertz, tick, due: 0, last: 0, speed: 1};
      const stepped = () => { clock.pause(); step(); this.redraw(); };
      const toggle = () => (calm() ? stepped() : clock.running ? clock.pause() : clock.start());
      clock.start = () => { clock.running = true; clock.due = 0; clock.last = performance.now(); write(); this.redraw(); };
      clock.wake = () => { if (!clock.running && !calm()) clock.start(); };  // for who drives without pressing Start
      clock.fold = () => { if (button && one) this.buttons.prepend(one); };
      clock.pause = () => { clock.running = false; write(); this.redraw(); };
      const button = calm() ? null : this.button({name: go, press: toggle});
      const write = () => { if (button) button.textContent = clock.running ? stop : go; };
      const one = button && this.small ? null : this.button({name: "Step", key: ".", press: stepped});
      (button || one).classList.add("pfslam-main");
      this.shortcuts[" "] = toggle;
      this.beat = clock;
      return clock;
    }

    /** Mouse, pen and finger on a plan; the handlers get metres. A finger that moves up or down scrolls the page and
     * changes nothing. One that taps, moves sideways, or begins where `grab(x, y)` is true, acts, until a second finger comes:
     * two of them want to see something from nearer. */
    drag(plan, {start, move = () => {}, end = () => {}, grab = () => false}) {
      const {canvas} = plan, place = event => plan.world(event.offsetX, event.offsetY);
      let held = null, from = null, begun = false;
      const begin = () => {
        begun = true;
        plan.holder.focus({preventScroll: true});
        start(...from);
      };
      const second = event => { if (event.pointerId !== held) drop(true); };  // anywhere on the page: it pinches or scrolls
      const drop = cancelled => {
        held = null;
        root.removeEventListener("pointerdown", second);
        if (!begun && !cancelled) begin();
        if (begun) end(cancelled);
        this.redraw();
      };
      canvas.addEventListener("touchstart", event => {
        const {left, top} = canvas.getBoundingClientRect(), [touch, other] = event.touches;
        if (!other && grab(...plan.world(touch.clientX - left, touch.clientY - top))) event.preventDefault();
      }, {passive: false});
      canvas.addEventListener("pointerdown", event => {
        if (held !== null) { drop(true); return; }
        if (event.button !== 0) return;
        Object.assign(this, {touched: event.pointerType === "touch"});
        [held, from, begun] = [event.pointerId, place(event), false];
        canvas.setPointerCapture(held);
        root.addEventListener("pointerdown", second);
        if (!this.touched || grab(...from)) begin();
        this.redraw();
      });
      canvas.addEventListener("pointermove", event => {
        if (held === null && event.pointerType === "mouse") canvas.style.cursor = grab(...place(event)) ? "grab" : "";
        if (event.pointerId !== held) return;
        if (!begun && Math.abs(plan.at(...from)[0] - event.offsetX) > SIDEWAYS) begin();
        if (begun) move(...place(event));
        this.redraw();
      });
      for (const kind of ["pointerup", "pointercancel"]) {
        canvas.addEventListener(kind, event => {
          if (event.pointerId === held) drop(kind === "pointercancel");
        });
      }
    }

    /** A thing in a sheet that stands for sliders, `inputs` by key. Where a finger can take hold of it, `take(x, y)` gives a function
     * from the place to which it is dragged to {key: value}; elsewhere it gives null. */
    handle(sheet, inputs, take) {
      const put = values => Object.entries(values).forEach(([key, value]) => turn(inputs[key], value));
      let to = null, before = null;
      this.drag(sheet, {
        start: (x, y) => {
          to = take(x, y);
          before = Object.fromEntries(Object.entries(inputs).map(([key, input]) => [key, input.value]));
          if (to && this.beat) this.beat.pause();
        },
        move: (x, y) => { if (to) put(to(x, y)); },
        end: cancelled => { if (to && cancelled) put(before); },
        grab: (x, y) => take(x, y) !== null,
      });
    }

    /** Keys that are pressed (`handler(true)`) and let go (`handler(false)`) while the plan has the focus. For the first plan
     * arrows are heard on a button, too: who has pressed Start may drive on. */
    keys(plan, handlers) {
      const ours = ({target, key}) => {
        const place = target.closest(".pfslam-plan");
        return place ? place === plan.holder
          : plan === this.sheets[0] && target.matches("button") && key.startsWith("Arrow");
      };
      const heard = down => event => {
        if (!handlers[event.key] || !ours(event) || event.altKey || event.ctrlKey || event.metaKey) return;
        event.preventDefault();
        handlers[event.key](down);
        this.redraw();
      };
      this.figure.addEventListener("keydown", heard(true));
      this.figure.addEventListener("keyup", heard(false));
      this.figure.addEventListener("focusout", () => Object.values(handlers).forEach(handler => handler(false)));
    }

    /** The letters on the buttons, wherever in the laboratory the focus is; the space bar only on a plan. */
    pressed(event) {
      const action = this.shortcuts[event.key.toLowerCase()];
      if (!action || event.altKey || event.ctrlKey || event.metaKey || event.repeat) return;
      if (event.key === " " && !event.target.matches(".pfslam-plan")) return;
      event.preventDefault();
      action();
    }

    /** Taps and arrow keys on a plan drive: a place goes to `goTo(x, y)`, an arrow to `hold(name, down)`. Each of the `things`
     * {grab(x, y), take(), move(x, y)} can be taken hold of and moved; `take()` gives what puts it back. */
    steered(plan, {goTo, hold, things = []}) {
      let held = null, putBack = null;
      const at = (x, y) => things.find(thing => thing.grab(x, y)) || null;
      this.drag(plan, {
        start: (x, y) => {
          held = at(x, y);
          if (held) putBack = held.take();
          else goTo(x, y);
        },
        move: (x, y) => (held ? held.move(x, y) : goTo(x, y)),
        end: cancelled => { if (held && cancelled) putBack(); },
        grab: (x, y) => at(x, y) !== null,
      });
      const key = name => down => hold(name, down);
      this.keys(plan, {ArrowUp: key("up"), ArrowDown: key("down"), ArrowLeft: key("left"), ArrowRight: key("right")});
    }

    /** Let the reader drive a robot by taps, arrow keys and the autopilot's box, which is returned; `things` as for `steered`. */
    driven(plan, driver, clock, things = []) {
      const auto = this.check({name: "Autopilot", key: "a", value: true, change: value => {
        driver.setAuto(value);
        if (value) clock.wake();
      }});
      const byHand = () => { driver.setAuto(false); auto.checked = false; clock.wake(); };
      this.steered(plan, {
        goTo(x, y) { byHand(); driver.goTo(x, y); },
        hold(name, down) {
          driver.keys[name] = down;
          if (down) byHand();
        },
        things,
      });
      return auto;
    }

    tell(sentence) {
      if (sentence === (this.told || "")) return;
      this.told = sentence;
      Object.assign(this, {said: sentence, saidAt: performance.now()});
      this.status.textContent = sentence;
      this.status.classList.toggle("pfslam-told", Boolean(sentence));
    }

    say(sentence) {
      const now = performance.now();
      if (this.told || sentence === this.said || now - this.saidAt < 1000) return;
      Object.assign(this, {said: sentence, saidAt: now});
      this.status.textContent = sentence;
    }

    /** Say what is seen, or a little later if something was said just now: what is true at the end is said, too. */
    describe() {
      const quiet = this.beat && this.beat.running ? 5000 : 1000;  // who listens to a drive wants to hear other things, too
      const wait = this.saidAt + quiet - performance.now();
      clearTimeout(this.later);
      if (wait <= 0) this.say(this.parts.describe());
      else this.later = setTimeout(() => this.describe(), wait + 1);
    }

    /** A change that takes a moment before one's eyes: what it gives is asked for the share that has passed. With less
     * motion it is over at once. Only drawings ask; the state has changed already. */
    glide(seconds = 0.6) {
      const begun = performance.now();
      return () => {
        const share = calm() ? 1 : Math.min(1, (performance.now() - begun) / (1000 * seconds));
        if (share < 1) this.redraw();
        return share * share * (3 - 2 * share);
      };
    }

    redraw() {
      if (!this.asked) this.asked = requestAnimationFrame(now => this.frame(now));
    }

    /** One frame: the ticks that are due, then the pictures. It asks for the next only while a clock runs in view. */
    frame(now) {
      this.asked = null;
      const clock = this.beat;
      this.visible ??= inView(this.figure);  // the observer tells it a little later
      if (!this.visible || !this.parts || !this.fitted) return;
      if (!this.colours.paper) this.readColours();
      if (!this.colours.paper) { this.redraw(); return; }
      if (clock && clock.running) {
        // A machine that is too slow drives more slowly; it does not skip.
        clock.due = Math.min(clock.due + ((now - clock.last) / 1000) * clock.hertz * clock.speed, 4);
        clock.last = now;
        for (; clock.due >= 1 && clock.running; clock.due -= 1) clock.tick();
      }
      this.parts.draw();
      if (this.parts.describe) this.describe();
      if (clock && clock.running) this.redraw();
    }
  }

  const scratch = document.createElement("canvas");

  const draw = {
    /** What does not change in every frame: `paint(sheet)` draws it on a sheet of its own, like `plan`, and only when one of
     * `parts` is another than it was, or the plan has another size. */
    kept(plan, parts, paint) {
      const {width, height} = plan.canvas, {a: ratio} = plan.context.getTransform(), now = [...parts, width, height], layer = (plan.layer = plan.layer || document.createElement("canvas"));
      if (!plan.keptFor || now.some((part, k) => part !== plan.keptFor[k])) {
        plan.keptFor = now;
        Object.assign(layer, {width, height});  // which also clears it
        const context = layer.getContext("2d");
        context.setTransform(plan.context.getTransform());
        paint(Object.assign(Object.create(plan), {context}));
      }
      plan.context.drawImage(layer, 0, 0, width / ratio, height / ratio);
    },

    /** The map: unknown as paper, free and occupied by their log-odds, up to `full` (the clamp). */
    grid(plan, grid, colours, full) {
      const [height, width] = grid.spec.shape, {origin, resolution} = grid.spec;
      const store = (plan.store = plan.store || document.createElement("canvas"));
      if (plan.stored !== grid.logOdds || plan.storedIn !== colours) {  // a new map is a new array
        Object.assign(plan, {stored: grid.logOdds, storedIn: colours});
        draw.cells(store, grid, colours, full);
      }
      const [x, y] = plan.at(origin[0], origin[1] + height * resolution);
      plan.context.imageSmoothingEnabled = false;
      plan.context.drawImage(store, x, y, width * resolution * plan.scale, height * resolution * plan.scale);
    },

    /** The map on a canvas of its own, a pixel for a cell. */
    cells(store, grid, colours, full) {
      const [height, width] = grid.spec.shape;
      Object.assign(store, {width, height});
      const context = store.getContext("2d"), image = context.createImageData(width, height);
      const [paper, free, wall] = [colours.paper, colours.free, colours.wall].map(rgb);
      for (let iy = 0; iy < height; iy++) {
        for (let ix = 0; ix < width; ix++) {
          const value = grid.logOdds[iy * width + ix], at = 4 * ((height - 1 - iy) * width + ix);
          const towards = value > 0 ? wall : free, part = Math.min(1, Math.abs(value) / full);
          for (let c = 0; c < 3; c++) image.data[at + c] = paper[c] + part * (towards[c] - paper[c]);
          image.data[at + 3] = 255;
        }
      }
      context.putImageData(image, 0, 0);
    },

    /** Lines x, y, x, y, ... of the world; `gaps` makes every two points a line of their own. */
    line(plan, points, colour, {width = 2, dash = [], gaps = false} = {}) {
      const {context} = plan;
      context.beginPath();
      for (let k = 0; k < points.length; k += 2) {
        const [x, y] = plan.at(points[k], points[k + 1]);
        if (k === 0 || (gaps && k % 4 === 0)) context.moveTo(x, y);
        else context.lineTo(x, y);
      }
      Object.assign(context, {strokeStyle: colour, lineWidth: width});
      context.setLineDash(dash);
      context.stroke();
      context.setLineDash([]);
    },

    /** Squares of `side` pixels at points x, y, x, y, ...: thousands of dots, one by one, would hold the page up. They are put
     * together as an image of their own, so that none is darker where they overlap. */
    specks(plan, points, colour, side) {
      const {context} = plan, {width, height} = context.canvas, {a: ratio, e: left, f: top} = context.getTransform(), size = Math.ceil(side * ratio);
      const corners = new Float64Array(points.length), low = [width, height], high = [0, 0];
      for (let k = 0; k < points.length; k += 2) {
        const [x, y] = plan.at(points[k], points[k + 1]), across = Math.round(ratio * x + left - size / 2), down = Math.round(ratio * y + top - size / 2);
        corners[k] = across;
        corners[k + 1] = down;
        if (across < low[0]) low[0] = Math.max(across, 0);
        if (down < low[1]) low[1] = Math.max(down, 0);
        if (across + size > high[0]) high[0] = Math.min(across + size, width);
        if (down + size > high[1]) high[1] = Math.min(down + size, height);
      }
      const across = high[0] - low[0], down = high[1] - low[1];
      if (across <= 0 || down <= 0) return;
      const image = context.createImageData(across, down), pixels = new Uint32Array(image.data.buffer);
      const [ink] = new Uint32Array(Uint8Array.of(...rgb(colour), 255).buffer);
      for (let k = 0; k < corners.length; k += 2) {
        const from = Math.max(corners[k] - low[0], 0), to = Math.min(corners[k] - low[0] + size, across);
        const last = Math.min(corners[k + 1] - low[1] + size, down);
        for (let row = Math.max(corners[k + 1] - low[1], 0); row < last; row++) {
          for (let at = row * across + from; at < row * across + to; at++) pixels[at] = ink;
        }
      }
      Object.assign(scratch, {width: across, height: down});
      scratch.getContext("2d").putImageData(image, 0, 0);
      context.save();
      context.resetTransform();
      context.drawImage(scratch, ...low);
      context.restore();
    },

    /** Dots at points x, y, x, y, ...; `radius` in pixels, one or one for each; a `rim` {colour, width} tells neighbours apart. */
    dots(plan, points, colour, radius, rim = null) {
      const {context} = plan;
      if (rim) {  // disc on disc: as a line a rim takes three times as long
        for (let k = 0; k < points.length; k += 2) {
          const [x, y] = plan.at(points[k], points[k + 1]), r = radius.length ? radius[k / 2] : radius;
          for (const [fill, beyond] of [[rim.colour, rim.width / 2], [colour, -rim.width / 2]]) {
            context.fillStyle = fill;
            context.beginPath();
            context.arc(x, y, Math.max(0, r + beyond), 0, 2 * Math.PI);
            context.fill();
          }
        }
        return;
      }
      context.fillStyle = colour;
      context.beginPath();
      if (!radius.length && radius < 1.6) {  // thousands of them are slow as one path
        for (let k = 0; k < points.length; k += 2) {
          const [x, y] = plan.at(points[k], points[k + 1]);
          context.fillRect(x - radius, y - radius, 2 * radius, 2 * radius);
        }
        return;
      }
      for (let k = 0; k < points.length; k += 2) {
        const [x, y] = plan.at(points[k], points[k + 1]), r = radius.length ? radius[k / 2] : radius;
        if (r < 1.6) context.rect(x - r, y - r, 2 * r, 2 * r);
        else { context.moveTo(x + r, y); context.arc(x, y, r, 0, 2 * Math.PI); }
      }
      context.fill();
    },

    /** Particles: dots whose area is their weight, `radius` pixels for the average one, each with a
     * rim, which tells neighbours apart, and with a line to the front if asked for. */
    particles(plan, poses, weights, colours, {radius = 3, headings = false, rims = true} = {}) {
      const n = weights.length, places = new Float64Array(2 * n), radii = new Float64Array(n);
      for (let k = 0; k < n; k++) {
        places.set(poses.subarray(3 * k, 3 * k + 2), 2 * k);
        radii[k] = Math.max(0.6, Math.min(3 * radius, radius * Math.sqrt(n * weights[k])));
      }
      if (headings) {
        const lines = new Float64Array(4 * n), length = (4 * radius) / plan.scale;
        for (let k = 0; k < n; k++) {
          const x = poses[3 * k], y = poses[3 * k + 1], theta = poses[3 * k + 2];
          lines.set([x, y, x + length * Math.cos(theta), y + length * Math.sin(theta)], 4 * k);
        }
        draw.line(plan, lines, colours.particles, {width: 1, gaps: true});
      }
      draw.dots(plan, places, colours.particles, radii);
      if (!rims) return;
      Object.assign(plan.context, {strokeStyle: colours.estimate, lineWidth: 0.75});
      plan.context.stroke();
    },

    /** Beams from a sensor [x, y] to their end points. */
    rays(plan, sensor, points_w, colour, width = 1) {
      const lines = new Float64Array(2 * points_w.length);
      for (let k = 0; k < points_w.length; k += 2) lines.set([...sensor, points_w[k], points_w[k + 1]], 2 * k);
      plan.context.globalAlpha = 0.35;
      draw.line(plan, lines, colour, {width, gaps: true});
      plan.context.globalAlpha = 1;
    },

    /** The robot: a disc of `radius` m with two wheels and a line to the front, so large that it can be seen; `fill` for a
     * solid one. */
    robot(plan, pose, colour, {radius = 0.22, fill = null} = {}) {
      const {context} = plan, [x, y] = plan.at(pose[0], pose[1]), r = Math.max(radius * plan.scale, 6), [c, s] = [Math.cos(pose[2]), -Math.sin(pose[2])];
      context.beginPath();
      context.arc(x, y, r, 0, 2 * Math.PI);
      if (fill) { context.fillStyle = fill; context.fill(); }
      context.moveTo(x, y);
      context.lineTo(x + 1.6 * r * c, y + 1.6 * r * s);
      Object.assign(context, {strokeStyle: colour, lineWidth: 2.5});
      context.stroke();
      context.beginPath();
      for (const side of [-r, r]) {
        context.moveTo(x - side * s - 0.5 * r * c, y + side * c - 0.5 * r * s);
        context.lineTo(x - side * s + 0.5 * r * c, y + side * c + 0.5 * r * s);
      }
      context.lineWidth = Math.max(3.5, 0.35 * r);
      context.stroke();
    },

    /** A knob: here something can be taken hold of. */
    knob(plan, place, colours, name = "estimate") {
      const {context} = plan, [x, y] = plan.at(...place);
      context.beginPath();
      context.arc(x, y, 9, 0, 2 * Math.PI);
      Object.assign(context, {fillStyle: colours.free, strokeStyle: colours[name], lineWidth: 2.5});
      context.fill();
      context.stroke();
    },

    /** Bars of `values` from 0 to `top`, side by side across a sheet. */
    bars(sheet, values, top, colour) {
      const {context} = sheet, step = sheet.width / values.length;
      context.fillStyle = colour;
      values.forEach((value, k) => {
        const height = (value / top) * (sheet.height - 2);
        context.fillRect(k * step + 0.1 * step, sheet.height - height, 0.8 * step, height);
      });
    },

    /** The last `room` values of a series as a curve from 0 to `top`, the newest at the right, and a level across it. */
    strip(sheet, values, {room, top, level, colour, levelColour}) {
      const {context} = sheet, y = value => 2 + (1 - value / top) * (sheet.height - 4);
      Object.assign(context, {strokeStyle: levelColour, lineWidth: 1});
      context.setLineDash([4, 4]);
      context.beginPath();
      context.moveTo(0, y(level));
      context.lineTo(sheet.width, y(level));
      context.stroke();
      context.setLineDash([]);
      context.beginPath();
      values.slice(-room).forEach((value, k, shown) => {
        context.lineTo(sheet.width * (1 - (shown.length - 1 - k) / (room - 1)), y(value));
      });
      Object.assign(context, {strokeStyle: colour, lineWidth: 2});
      context.stroke();
    },

    /** Words at a pixel; with a `halo` they can be read over lines. */
    text(sheet, words, x, y, colour, {size = 14, align = "left", halo = null} = {}) {
      const {context} = sheet;
      Object.assign(context, {fillStyle: colour, font: `${size}px system-ui, sans-serif`, textAlign: align});
      if (halo) {
        Object.assign(context, {strokeStyle: halo, lineWidth: 5, lineJoin: "round"});
        context.strokeText(words, x, y);
      }
      context.fillText(words, x, y);
    },
  };

  /** Red, green and blue (0 to 255) of a colour as the style sheet writes it: #rrggbb. */
  function rgb(colour) {
    return [1, 3, 5].map(k => parseInt(colour.slice(k, k + 2), 16));
  }

  /** A colour as it is far away on a ground. */
  function paler(colour, ground) {
    const there = rgb(ground), mixed = rgb(colour).map((value, k) => Math.round(there[k] + PALE * (value - there[k])));
    return `#${mixed.map(value => value.toString(16).padStart(2, "0")).join("")}`;
  }

  function inView(figure) {
    const {top, bottom} = figure.getBoundingClientRect();
    return bottom > 0 && top < root.innerHeight;
  }

  /** Turn a slider, as the reader would. */
  function turn(input, value) {
    const before = input.value;
    input.value = value;
    if (input.value !== before) input.dispatchEvent(new Event("input"));
  }

  const isSeed = text => /^\d{1,9}$/.test(text);

  /** What the page's address asks of the laboratory with this label, #lab=label&key=text: {key: text}; else null. */
  function asks(label) {
    const {lab, ...asked} = Object.fromEntries(new URLSearchParams(root.location.hash.slice(1)));
    return lab === label ? asked : null;
  }

  /** Build the laboratory `name` in a figure; `host` is what JupyterLab hands in, where no address leads to a laboratory. */
  function mount(figure, name, options, host) {
    const same = [...document.querySelectorAll(`figure.pfslam-lab[data-lab="${name}"]`)].indexOf(figure);
    const label = same > 0 ? `${name}-${same + 1}` : name, asked = host ? null : asks(label);
    const seed = asked && isSeed(asked.seed) ? {seed: Number(asked.seed)} : {};
    const stage = new Stage(figure, {...options, ...seed});
    stage.host = host;
    stage.parts = figure.lab = Object.assign(known.builders[name](stage), {stage});
    if (!host) stage.linked(label, asked);
    if (asked) comeTo(figure);
    stage.fit();
    stage.redraw();
  }

  /** Bring a figure into view, and again when the page above it is whole. */
  function comeTo(figure) {
    const come = () => figure.scrollIntoView();
    root.history.scrollRestoration = "manual";
    come();
    root.addEventListener("load", come);
  }
  // Who changes the address of an open page wants what it asks for.
  root.addEventListener("hashchange", () => { if (root.location.hash.startsWith("#lab=")) root.location.reload(); });

  function lab(name, build) {
    known.builders[name] = build;
    document.querySelectorAll(`figure.pfslam-lab[data-lab="${name}"]:not(.pfslam-live)`).forEach(figure => {
      mount(figure, name, JSON.parse(figure.dataset.options || "{}"));
    });
  }

  Object.assign(root.pfslam, {lab, mount, draw, make, turn});
})(globalThis);
