/* A picture with a slider: panels with axes whose curves and dots the page computes from the numbers of a cell.
 *
 * A picture is a file of its own, `picture_NAME.js`, that calls `pfslam.picture(name, make)`. `make(data)` gets what the
 * chapter hands on and returns {
 *   label,                                  what the canvas shows, in words
 *   controls: {key: {name, min, max, step, value, unit, digits} or {name, options, value}},   in the words of the stage; choices first
 *   play: {key, seconds},                   the slider that a clock moves from one end to the other, if any
 *   tall: [wide, narrow],                   the height of the canvas by its width, beside each other and on a phone
 *   places: {wide: [[x, y, width, height], ...], narrow},   of the panels, in shares, where they do not stand in a row
 *   help, keys: {ArrowLeft: [key, steps], ...},   what fingers and keys do, where a thing in the picture stands for the sliders
 *   compute(values, again) {return {panels, words, ...}},   `words` say what is seen; `again()` computes once more
 * }
 * A panel is {title, x: [from, to], y: [from, to], xName, yName, xTicks, yTicks, equal, paint(pen, colours)}; `pen` is a
 * plan for `pfslam.draw`. Ticks are {value: word}, or are found. A panel with a thing to take hold of has also {grip: [x0, y0, x1,
 * y1], to(x, y)}: from where to where it reaches, and the {key: value} of the controls when it is dragged to a place. Its picture
 * has `help`, and `compute` gives a `line` above it that says what to drag; the sliders are then folded.
 */
(function (root) {
  "use strict";
  const {core, draw, lab, turn} = root.pfslam;
  const NARROW = 480, HERTZ = 30, STEPS = 12;  // pixels; ticks a second; steps of who does not want motion

  /** Numbers Float64Array(n) as Python packed them: whole numbers of two bytes, times a unit. */
  function unpack({unit, base64}) {
    const bytes = Uint8Array.from(atob(base64), letter => letter.charCodeAt(0)), view = new DataView(bytes.buffer);
    return Float64Array.from({length: bytes.length / 2}, (_, k) => unit * view.getInt16(2 * k, true));
  }

  /** Scans along a path (`scans_along` in Python): a function of an offset of their stamps (s) to the points of each. */
  function along({t, ranges, times, poses, lidar}) {
    const points_b = ranges.map(scan => core.scanPoints(unpack(scan).map(Math.fround), lidar));
    return offset => points_b.map((points, k) => core.transformPoints(core.poseAt(times, poses, t[k] + offset), points));
  }

  /** Ticks at some four round numbers of a range. */
  function roundTicks([from, to]) {
    const rough = (to - from) / 4, ten = 10 ** Math.floor(Math.log10(rough)), ticks = {};
    const step = ten * [1, 2, 5, 10].find(times => times * ten >= rough * 0.8), digits = Math.max(0, -Math.floor(Math.log10(step) + 1e-9));
    for (let k = Math.ceil(from / step - 1e-9); k * step <= to + 1e-9; k++) ticks[k * step] = (k * step).toFixed(digits).replace("-", "\u2212");
    return ticks;
  }

  /** A plan that draws into a part of a sheet: its scales may differ, and what lies outside is cut off. */
  function penOf(sheet, {x, y, equal}, [left, top, width, height]) {
    let across = width / (x[1] - x[0]), up = height / (y[1] - y[0]);
    if (equal) across = up = Math.min(across, up);
    const box = [left + (width - across * (x[1] - x[0])) / 2, top, across * (x[1] - x[0]), up * (y[1] - y[0])];
    return {
      context: sheet.context, box, scale: across,
      at: (px, py) => [box[0] + (px - x[0]) * across, box[1] + (y[1] - py) * up],
      world: (px, py) => [x[0] + (px - box[0]) / across, y[1] - (py - box[1]) / up],
    };
  }

  /** The plan of a panel in a rectangle of the sheet, with room for its frame. */
  function penIn(sheet, panel, [left, top, width, height]) {
    return penOf(sheet, panel, panel.xTicks === null ? [left, top + 26, width, height - 26]
      : [left + 62, top + 26, width - 72, height - 26 - (panel.xName ? 44 : 24)]);
  }

  /** One panel, with its frame. */
  function paint(sheet, colours, panel, pen) {
    const {context, box} = pen;
    draw.text(sheet, panel.title || "", box[0] + box[2] / 2, box[1] - 8, colours.ink, {size: 14, align: "center"});
    if (panel.xTicks !== null) frame(sheet, colours, panel, pen);
    context.save();
    context.beginPath();
    context.rect(...box);
    context.clip();
    panel.paint(pen, colours);
    context.restore();
  }

  function frame(sheet, colours, panel, {context, box: [left, top, width, height], at}) {
    const {x, y} = panel, grid = context.globalAlpha;
    context.globalAlpha = 0.35;
    Object.assign(context, {strokeStyle: colours.muted, lineWidth: 1});
    const words = [];
    for (const [value, word] of Object.entries(panel.xTicks || roundTicks(x))) {
      const [px] = at(Number(value), y[0]);
      context.strokeRect(px, top, 0, height);
      words.push([word, px, top + height + 17, "center"]);
    }
    for (const [value, word] of Object.entries(panel.yTicks || roundTicks(y))) {
      const [, py] = at(x[0], Number(value));
      context.strokeRect(left, py, width, 0);
      words.push([word, left - 5, py + 4, "right"]);
    }
    context.globalAlpha = grid;
    for (const [word, px, py, align] of words) draw.text(sheet, word, px, py, colours.ink, {size: 12, align});
    if (panel.xName) draw.text(sheet, panel.xName, left + width / 2, top + height + 36, colours.ink, {size: 13, align: "center"});
    if (!panel.yName) return;
    context.save();
    context.translate(left - 50, top + height / 2);
    context.rotate(-Math.PI / 2);
    draw.text(sheet, panel.yName, 0, 0, colours.ink, {size: 13, align: "center"});
    context.restore();
  }

  /** Where the panels stand: beside each other, or on a phone one below the other. */
  function rooms(sheet, {places}, count) {
    const {width, height} = sheet, wide = width >= NARROW;
    const row = Array.from({length: count}, (_, k) => (wide ? [k / count, 0, 1 / count, 1] : [0, k / count, 1, 1 / count]));
    return (places ? places[wide ? "wide" : "narrow"] : row).map(([x, y, w, h]) => [x * width, y * height, w * width, h * height]);
  }

  /** The pixel of a grip that is nearest to a pixel. */
  function nearest(pen, [x0, y0, x1, y1], px, py) {
    const [left, top] = pen.at(x0, y0), [right, low] = pen.at(x1, y1), [dx, dy] = [right - left, low - top], long = dx * dx + dy * dy;
    const part = long ? Math.max(0, Math.min(1, ((px - left) * dx + (py - top) * dy) / long)) : 0;
    return [left + part * dx, top + part * dy];
  }

  /** Let the reader take hold of what stands in the panels, and turn the sliders with it. */
  function handles(stage, sheet, state, pen, sliders) {
    stage.handle(sheet, sliders, (px, py) => {
      const k = state.seen.panels.findIndex(({grip}, one) => grip && sheet.near(px, py, nearest(pen(one), grip, px, py)));
      return k < 0 ? null : (qx, qy) => state.seen.panels[k].to(...pen(k).world(qx, qy));
    });
    const moved = (key, by) => down => { if (down) turn(sliders[key], Number(sliders[key].value) + by * sliders[key].step); };
    stage.keys(sheet, Object.fromEntries(Object.entries(state.picture.keys).map(([name, [key, by]]) => [name, moved(key, by)])));
  }

  /** A clock that moves a slider from one end to the other, and stops there. */
  function player(stage, {seconds}, slider) {
    let at = null;
    const go = by => {
      const input = slider(), [low, high] = [Number(input.min), Number(input.max)];
      const from = at !== null && Math.abs(at - input.value) <= input.step ? at : Number(input.value);
      at = from >= high ? low : Math.min(high, from + by * (high - low));
      input.value = at;
      input.dispatchEvent(new Event("input"));
      if (at >= high) clock.pause();
    };
    const clock = stage.clock({hertz: HERTZ, tick: () => go(1 / (seconds * HERTZ)), step: () => go(1 / STEPS)});
    return clock;
  }

  function picture(name, make) {
    lab(name, stage => {
      const picture = make(stage.options), {controls, help, play, compute, tall = [0.5, 1.2]} = picture, values = {}, sliders = {};
      const state = {values, seen: null, picture};
      const see = () => { state.seen = compute(values, () => { see(); stage.redraw(); }); };
      const sheet = stage.chart({name: picture.label, help, height: width => Math.round(width * tall[width >= NARROW ? 0 : 1])});
      const pen = k => penIn(sheet, state.seen.panels[k], rooms(sheet, picture, state.seen.panels.length)[k]);
      const clock = play && player(stage, play, () => sliders[play.key]);
      for (const [key, control] of Object.entries(controls)) {
        const change = value => { values[key] = value; see(); };
        if (help && !control.options && !stage.box) stage.fold("More");
        values[key] = control.value;
        if (control.options) stage.choice({...control, change});
        else sliders[key] = stage.slider({...control, change});
      }
      if (help && clock) clock.fold();
      see();
      if (help) handles(stage, sheet, state, pen, sliders);
      return {
        state,
        at: (k, ...place) => pen(k).at(...place),
        draw() {
          const {panels, line = ""} = state.seen;
          sheet.write(line);
          sheet.clear(stage.colours.sheet);
          panels.forEach((panel, k) => paint(sheet, stage.colours, panel, pen(k)));
        },
        describe: () => state.seen.words,
      };
    });
  }

  Object.assign(root.pfslam, {picture, unpack, along});
})(globalThis);
