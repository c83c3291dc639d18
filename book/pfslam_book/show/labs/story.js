/* The first minute: what the first page tells with the robot of `lab_drive.js`, in four beats, before the reader drives.
 *
 * The same drive comes three times: by wheels and gyro alone; with a hundred guesses that nothing chooses from; with scans
 * that choose. The third goes on to the end of its lap and paints the floor. What the reader does then is written down, so
 * that a link can drive the same drive again.
 */
(function (root) {
  "use strict";
  const {core, draw, make, world} = root.pfslam;

  const SECONDS = 15, REST = 6, RESUME = 5, FORGIVE = 20;  // of a beat; of a finished floor; until the autopilot helps; of a lost robot
  const PACE = 1.4, LAP_PACE = 2;  // how fast the clock goes in the first three beats, and in the fourth: the lap ends with it
  const TRAIL = 900;  // ticks of the path by wheels and gyro that stay in view: the whole one would be scribble
  const LISTENED = 20;  // seconds between two readings for who listens
  const LOST = 0.6, STEP = 0.05;  // m: an estimate so far off is lost; a place in a link is told in such steps
  const SETTINGS = {particles: 100, noise: 0.7, sharpness: 12, free: 0.15};
  // Where drives begin [x, y, theta], and on the way to which corner of the route. On each the estimate is at no time worse than
  // the wheels for longer than half a second (`test_story.py`).
  const STARTS = [
    {start: [0.7, 3, 0], leg: 0}, {start: [1.7, 1.2, 0], leg: 7}, {start: [7.3, 4.8, Math.PI], leg: 2},
    {start: [2.1, 4.8, -Math.PI / 2], leg: 4}, {start: [6.9, 1.2, Math.PI / 2], leg: 9},
  ];
  const BEATS = [
    {title: "Wheels alone", settings: {blind: true, particles: 1, noise: 0}, shown: {truth: true}, pace: PACE,
     words: "The robot adds up what its wheels and its gyro say. It draws what its scanner sees where that sum says it is. " +
       "Small errors add up, too: the walls smear, and it leaves the true walls (thin lines)."},
    {title: "A hundred guesses", settings: {blind: true}, shown: {truth: true, map: false, scan: false}, pace: PACE,
     words: "The same drive again. Nobody knows the errors, so each of a hundred blue dots tries its own. They spread. Some " +
       "end nearer to the true robot (grey disc) than the wheels do, but which?"},
    {title: "Scans choose among them", settings: {}, shown: {alone: TRAIL}, pace: PACE,
     words: "The same drive once more. Seen from each dot, a scan fits the map well or badly. Dots from which it fits are " +
       "copied, the others go. Now the walls stay sharp."},
    {title: "The floor appears", settings: {}, shown: {alone: TRAIL, floor: true}, pace: LAP_PACE,
     words: "The robot knows where it is, so its camera's pictures can be laid on the map, one beside the other: the floor appears."},
    {title: "Now you drive", settings: {}, shown: {alone: TRAIL, floor: true}, pace: 1,
     words: "Tap a place, or use the arrow keys. <i>Share</i> gives you a picture of the floor that you painted, and a link that " +
       "drives your drive again."},
  ];
  const CHOOSING = 2, DRIVING = 4;  // the beats from which scans choose, and in which the reader drives
  const MOVE = /([0-9a-z]+)(G[0-9a-z]{4}|[AKB]|[UDLR][01])/g;  // after so many ticks: go there, autopilot, thief, back; a key
  const ARROWS = {U: "up", D: "down", L: "left", R: "right"};

  /** Which beat it is, the drive that is shown, and what has been done to it. */
  class Story {
    constructor({Drive, HERTZ, ROUTE, calm}, start) {
      Object.assign(this, {Drive, HERTZ, ROUTE, calm, start});
      this.show(calm ? 3 : 0);
    }

    /** A beat from its beginning: the same drive comes three times, so that they can be compared. Scans that choose go on choosing; everything else begins the drive anew. */
    show(beat) {
      const goesOn = this.beat >= CHOOSING && beat > this.beat;
      this.beat = beat;
      if (!goesOn) this.begin(this.start);
    }

    /** A drive from one of the starts, as the beat wants it, and nothing done to it yet. */
    begin(start) {
      const settings = {...SETTINGS, ...BEATS[this.beat].settings, ...STARTS[start]};
      Object.assign(this, {start, drive: new this.Drive(settings), log: [], coming: [], until: 0, rest: null, touched: false,
                           idle: 0, astray: 0, legs: 0, heard: null});
      this.leg = this.drive.leg;
    }

    /** The next start: who goes on watching sees another drive. */
    elsewhere() {
      this.beat = DRIVING;
      this.begin((this.start + 1) % STARTS.length);
    }

    /** One tick: of a rest, or of the drive with all that is due in it. */
    tick() {
      const {drive, rest, HERTZ} = this;
      if (rest) {
        rest.ticks -= 1;
        if (rest.ticks <= 0) { this.rest = null; rest.then(); }
        return;
      }
      while (this.coming.length && this.coming[0][0] <= drive.ticks) this.act(this.coming.shift()[1]);
      drive.tick();
      if (drive.leg !== this.leg) { this.leg = drive.leg; this.legs += 1; }
      if (this.beat <= CHOOSING && drive.ticks >= SECONDS * PACE * HERTZ) this.show(this.beat + 1);
      else if (this.until && drive.ticks >= this.until) this.pause(() => { this.until = 0; });
      else if (!this.touched && this.legs > this.ROUTE.length) { this.beat = DRIVING; this.pause(() => this.elsewhere()); }
      else this.care();
    }

    /** Let what has been painted be seen before something else happens. */
    pause(then) { this.rest = {ticks: REST * this.HERTZ, then}; }

    /** It never comes to a dead end: a refusal is forgotten, an autopilot takes over, a robot that is lost begins elsewhere. */
    care() {
      const {drive, HERTZ, coming} = this;
      const busy = drive.auto || drive.way.length || Object.values(drive.keys).some(Boolean);
      this.idle = busy ? 0 : this.idle + 1;
      this.astray = drive.before || drive.off > LOST ? this.astray + 1 : 0;
      if (this.idle > RESUME * HERTZ && !coming.length) this.act("A");
      if (this.beat === DRIVING && this.astray > FORGIVE * HERTZ && drive.auto) this.elsewhere();
    }

    /** What the reader does: from now on it is his drive. */
    byHand(code) {
      if (this.beat < DRIVING) this.show(DRIVING);
      Object.assign(this, {coming: [], until: 0, rest: null});
      this.act(code);
    }

    /** Do what a code of a link says, and write it down. */
    act(code) {
      const {drive, log} = this, [kind, down] = code;
      log.push([drive.ticks, code]);
      Object.assign(this, {touched: true, idle: 0, astray: 0});
      if (kind === "A") drive.setAuto(true);
      else if (kind === "K") drive.kidnap();
      else if (kind === "B" && drive.before) drive.putBack();
      else if (kind === "G") drive.goTo(...[1, 3].map((at, k) => drive.grid.spec.origin[k] + STEP * parseInt(code.slice(at, at + 2), 36)));
      else if (kind in ARROWS) {
        if (down === "1") drive.setAuto(false);
        drive.keys[ARROWS[kind]] = down === "1";
      }
    }

    /** Drive to the place, or to the floor that is nearest to it: who taps a wall means the floor before it. */
    goTo(x, y) {
      const {drive} = this, {origin} = drive.grid.spec;
      const at = ([px, py]) => [px - origin[0], py - origin[1]].map(d => Math.max(0, Math.round(d / STEP)).toString(36).padStart(2, "0")).join("");
      const code = `G${at(floorNear(drive, [x, y]))}`, last = this.log[this.log.length - 1];
      if (drive.target && last && last[1] === code) return;  // a finger that rests asks once
      this.byHand(code);
      if (this.calm) for (let k = 0; k < 60 * this.HERTZ && this.drive.way.length; k++) this.tick();
    }

    /** An arrow key goes down or up; a browser repeats itself, and a link should not. */
    hold(name, down) {
      if (Boolean(this.drive.keys[name]) === down) return;
      this.byHand(name[0].toUpperCase() + (down ? "1" : "0"));
    }

    /** The drive so far as a text: where it began, how many ticks it is long, and what was done after how many ticks. */
    get link() {
      let last = 0;
      const told = this.log.map(([tick, code]) => {
        const wait = tick - last;
        last = tick;
        return wait.toString(36) + code;
      });
      return [this.start, this.drive.ticks.toString(36), told.join("")].join("-");
    }

    /** Drive again what a link tells. */
    replay(text) {
      const [start, ticks, told] = text.split("-");
      let tick = 0;
      this.beat = DRIVING;
      this.begin(Number(start));
      this.coming = Array.from(told.matchAll(MOVE), ([, wait, code]) => [tick += parseInt(wait, 36), code]);
      this.until = parseInt(ticks, 36);
    }
  }

  const WHOLE_LINK = new RegExp(`^\\d-[0-9a-z]{1,6}-(${MOVE.source})*$`);
  const isLink = text => WHOLE_LINK.test(text) && Number(text[0]) < STARTS.length;

  /** The place to which a way leads that is nearest to a place, on rings around it; the place itself where there is none. */
  function floorNear(drive, [x, y]) {
    for (let away = 0; away < 4; away += 0.1) {
      for (let k = 0; k < 16; k++) {
        const place = [x + away * Math.cos(k * Math.PI / 8), y + away * Math.sin(k * Math.PI / 8)];
        if (drive.wayTo(place)) return place;
      }
    }
    return [x, y];
  }

  /** Each visit begins at another start than the last one; who keeps nothing gets any. */
  function nextStart() {
    try {
      const last = Number(root.localStorage.getItem("pfslam-start") ?? -1), next = (last + 1) % STARTS.length || 0;
      root.localStorage.setItem("pfslam-start", next);
      return next;
    } catch {
      return Math.floor(Math.random() * STARTS.length);
    }
  }

  /** How far off they are: in the first two beats nothing chooses, so the mean of the dots is not what matters. */
  function reading({drive, beat, rest, until}, news) {
    const cm = metres => (metres < 1 ? `${(100 * metres).toFixed(0)} cm` : `${metres.toFixed(1)} m`), {truth, poses, before, refused} = drive;
    if (before) return "Kidnapped: the robot was carried away, and the dots cannot know it.";
    if (rest && !refused) return until ? "This is the floor that was shared. Now you drive." : "The lap is over: this is the floor that the robot painted.";
    if (!drive.looks) return "The robot sets off.";
    if (beat === 0) return `Wheels and gyro are ${cm(drive.offAlone)} off.`;
    if (beat === DRIVING && drive.off > LOST) return `Lost: the dots are ${cm(drive.off)} off, and the map is spoilt. "Drive" begins anew, elsewhere.`;
    if (beat > 1) return news(drive).join(" ");
    let nearest = Infinity;
    for (let k = 0; k < poses.length; k += 3) nearest = Math.min(nearest, Math.hypot(poses[k] - truth[0], poses[k + 1] - truth[1]));
    return `The nearest guess is ${cm(nearest)} off, their mean ${cm(drive.off)}.`;
  }

  /** The map and the floor of a drive as a picture of its own. */
  function picture(plan, colours, drive, {CLAMP, paintFloor}) {
    const [wide, tall] = [plan.window[1] - plan.window[0], plan.window[3] - plan.window[2]], width = 1176, height = Math.round((width * tall) / wide), canvas = Object.assign(document.createElement("canvas"), {width, height});
    const sheet = Object.assign(Object.create(plan), {canvas, context: canvas.getContext("2d"), width, height});
    sheet.clear(colours.paper);
    draw.grid(sheet, drive.grid, colours, CLAMP);
    paintFloor(sheet, drive.floor);
    draw.robot(sheet, drive.estimate, colours.estimate, {radius: 0.2});
    draw.text(sheet, "My floor, painted by a particle filter. Particle-filter SLAM, line by line", 16, height - 16, colours.ink, {size: 26, halo: colours.paper});
    return new Promise(done => canvas.toBlob(done, "image/png"));
  }

  /** Give a picture and a link away: to the phone's own list of receivers, else as a file and in the clipboard. */
  async function give(stage, png) {
    const copied = stage.copyLink().then(() => "its link is copied", () => "the address of this page is its link");
    const file = new File([await png], "my-floor.png", {type: "image/png"}), sent = {files: [file], url: root.location.href};
    if (matchMedia("(pointer: coarse)").matches && navigator.canShare && navigator.canShare(sent)) {
      const done = await navigator.share(sent).then(() => true, error => error.name === "AbortError");
      if (done) return;
    }
    const link = make("a", {href: URL.createObjectURL(file), download: file.name});
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 10000);
    stage.tell(`The picture of your floor is saved as ${file.name}, and ${await copied}.`);
  }

  /** Build the story on a stage whose plan is there already; `kit` is what `lab_drive.js` has. */
  root.pfslam.story = (stage, plan, kit) => {
    const {calm} = stage, {HERTZ} = kit, story = new Story({...kit, calm}, nextStart());
    const title = make("b"), words = make("span"), said = make("p", {class: "pfslam-reading"});
    const beats = make("div", {class: "pfslam-buttons pfslam-beats", role: "group", "aria-label": "The story"}), ours = stage.buttons;
    const side = make("div", {class: "pfslam-side"}, make("p", {class: "pfslam-beat"}, title, " ", words), said, beats, ours, stage.status);
    stage.body.classList.add("pfslam-first");
    stage.controls.before(side);
    plan.widest = () => {  // beside its words, if they have room there, and all of it in the window
      const {clientWidth} = stage.body, wide = clientWidth >= 620;
      return Math.min(wide ? 0.57 * clientWidth : clientWidth, (wide ? root.innerHeight - 130 : 0.5 * root.innerHeight) / plan.aspect(1));
    };
    stage.setting("drive", () => story.link, isLink, text => story.replay(text));

    const clock = stage.clock({hertz: HERTZ, tick: () => story.tick(), step: () => move(HERTZ), names: ["Go on", "Hold"]});
    function move(ticks) { for (let k = 0; k < ticks; k++) story.tick(); }

    /** With less motion a beat is shown as it ends. It is worked out in pieces, so that the page stays awake. */
    async function hurry() {
      const {drive, beat} = story, over = () => story.drive !== drive || story.rest || (beat <= CHOOSING && drive.ticks + HERTZ >= SECONDS * PACE * HERTZ);
      drive.ready = false;
      while (!over()) {
        for (let k = 0; k < HERTZ && !over(); k++) story.tick();
        await new Promise(done => setTimeout(done));
      }
      drive.ready = true;
      stage.redraw();
    }
    function show(beat) {
      story.show(beat);
      if (calm) hurry();
      else clock.wake();
    }

    function elsewhere() {
      story.elsewhere();
      clock.wake();
      if (calm) hurry();
    }

    stage.buttons = beats;
    const marks = BEATS.map((beat, k) => {
      const button = stage.button({name: k < DRIVING ? `${k + 1}` : "Drive", press: () => (story.beat === DRIVING && k === DRIVING ? elsewhere() : show(k))});
      button.setAttribute("aria-label", k < DRIVING ? `${k + 1}: ${beat.title}` : beat.title);
      return button;
    });
    stage.buttons = ours;
    const skip = stage.button({name: "Skip", press: () => show(story.beat + 1)});
    const thief = stage.button({name: "Kidnap", key: "k", press: () => story.byHand(story.drive.before ? "B" : "K")});
    const share = stage.button({name: "Share", press: () => give(stage, picture(plan, stage.colours, story.drive, kit))});
    stage.steered(plan, {
      goTo(x, y) { story.goTo(x, y); clock.wake(); },
      hold(name, down) { story.hold(name, down); if (down) clock.wake(); },
    });
    if (calm) hurry();
    else clock.wake();

    let told = -1, looks = -1;
    return {
      get state() { return story.drive; },
      story, STARTS, BEATS,
      draw() {
        const {beat, drive} = story, {shown, pace} = BEATS[beat];
        clock.speed = story.rest ? 1 : pace;
        if (told !== beat) {
          told = beat;
          title.textContent = `${BEATS[beat].title}.`;
          words.innerHTML = BEATS[beat].words;
          marks.forEach((mark, k) => (k === beat ? mark.setAttribute("aria-current", "step") : mark.removeAttribute("aria-current")));
          skip.hidden = beat === DRIVING;  // never more than three controls beside the beats
          thief.hidden = beat < DRIVING;
          share.hidden = beat < CHOOSING;
          looks = -1;
        }
        thief.firstChild.data = drive.before ? "Put it back " : "Kidnap ";
        const now = `${drive.looks} ${drive.before} ${drive.refused} ${Boolean(story.rest)}`;
        if (looks !== now) {
          looks = now;
          said.textContent = reading(story, kit.news);
        }
        kit.paint(plan, stage.colours, drive, story.rest ? {...shown, alone: 0, scan: false} : shown);
      },
      /** For who listens: which beat it is; later what happens, and now and then how far off they are. */
      describe() {
        const {beat, drive, rest} = story, part = Math.floor(drive.ticks / (LISTENED * HERTZ));
        if (beat < DRIVING) return `${title.textContent} ${words.textContent}`;
        const heard = [part, Boolean(drive.before), Boolean(rest), drive.refused].join();
        if (story.heard !== heard) {
          story.spoken = `${story.heard ? "" : title.textContent} ${reading(story, kit.news)}`.trim();
          story.heard = heard;
        }
        return story.spoken;
      },
    };
  };
})(globalThis);
