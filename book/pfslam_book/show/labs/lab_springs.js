/* Springs (chapter 12): a pose graph to pull at. Each motion and each loop is a spring; the poses settle where all of them
 * together are least strained. */
(function (root) {
  "use strict";
  const {core, draw, lab} = root.pfslam;

  const N = 17, STRIDE = 1.5, SIDE = 4;  // poses; m from one to the next; strides on a side of the square
  const SIGMAS = [0.1, 0.1, 0.05], PULL = [0.02, 0.02, 10];  // m, m, rad: of a motion or a loop, and of the hand that pulls
  const KERNELS = [Infinity, 100, 30, 10, 3], ITERATIONS = 5;  // widths of the robust kernel, and steps with each
  const WINDOW = [-2.2, 9.4, -1.6, 7.6], LOOPS = {honest: [0, N - 1], false: [2, 11]};
  const information = sigmas => sigmas.map(sigma => sigma ** -2);

  /** The graph: poses as driven and as they are by now, motions, loops, and the hand. */
  class Graph {
    constructor(options) {
      this.settings = {drift: 0.05, honest: false, false: false, robust: false, ...options};
      this.truth = [[0, 0, 0]];
      for (let k = 1; k < N; k++) this.truth.push(core.compose(this.truth[k - 1], [STRIDE, 0, k % SIDE === 0 ? Math.PI / 2 : 0]));
      this.reset();
    }

    /** As driven: every motion turns too far by the drift (rad). */
    reset() {
      const {drift} = this.settings;
      this.chain = this.truth.slice(1).map((pose, k) => {
        const [x, y, theta] = core.between(this.truth[k], pose);
        return {i: k, j: k + 1, z: [1.01 * x, y, theta + drift], information: information(SIGMAS), loop: false};
      });
      this.poses = [[0, 0, 0]];
      for (const {z} of this.chain) this.poses.push(core.compose(this.poses[this.poses.length - 1], z));
      Object.assign(this, {held: null, round: 0, moved: Infinity});
    }

    /** Motions and the loops that are closed. The false one takes the middle of the third side for the middle of the first. */
    get edges() {
      const {settings, truth, chain} = this, loop = (name, z) => ({
        i: LOOPS[name][0], j: LOOPS[name][1], z, information: information(SIGMAS), loop: true, name});
      return [...chain, ...(settings.honest ? [loop("honest", core.between(truth[0], truth[N - 1]))] : []),
              ...(settings.false ? [loop("false", [0, 0, 0])] : [])];
    }

    /** The width of the kernel: wide at first, so that a true loop with a large error can close, and then narrower. */
    get width() { return this.settings.robust ? KERNELS[Math.min(Math.floor(this.round / ITERATIONS), KERNELS.length - 1)] : Infinity; }

    /** The weight of every edge: 1 for motions, by the kernel for loops. */
    get weights() { return this.edges.map(edge => (edge.loop ? core.robustWeight(core.chiSquare(edge, this.poses), this.width) : 1)); }

    /** Something was changed: relax anew, with a wide kernel. */
    shake() { Object.assign(this, {round: 0, moved: Infinity}); }

    /** One step of Gauss and Newton. The hand is a spring from pose 0 to the place at which it pulls. */
    step() {
      const {edges, weights, poses, held} = this, pull = [];
      if (held) pull.push({i: 0, j: held.k, z: core.between(poses[0], [...held.place, poses[held.k][2]]), information: information(PULL)});
      const next = core.graphStep([...edges, ...pull], poses, [...weights, ...pull.map(() => 1)]);
      this.moved = Math.max(...next.map((pose, k) => Math.hypot(pose[0] - poses[k][0], pose[1] - poses[k][1])));
      this.poses = next;
      this.round += 1;
    }

    get settled() { return this.moved < 1e-4 && this.round >= (this.settings.robust ? ITERATIONS * KERNELS.length : 1); }

    /** How far the poses are from the truth, m, root mean square. */
    get error() {
      return Math.sqrt(this.poses.reduce((sum, [x, y], k) => sum + (x - this.truth[k][0]) ** 2 + (y - this.truth[k][1]) ** 2, 0) / N);
    }
  }

  lab("springs", stage => {
    const graph = new Graph(stage.options), {settings} = graph;
    const plan = stage.plan({
      name: "The pose graph: poses joined by motions, and the loops",
      help: "Pull at a pose: drag it, and let go. Keys: left and right choose a pose, up pulls it outwards, down lets go.",
      window: WINDOW,
    });
    stage.words([["estimate", "the poses, joined by the measured motions."], ["muted", "where the robot truly was."],
                 ["clear", "a loop that is content,"], ["hits", "one that is strained; the thinner, the less it counts."]].map(([colour, words]) =>
      `<span class="pfslam-dot" aria-hidden="true" style="color:var(--lab-${colour})">●</span>\u00a0${words}`).join(" "));
    const strain = stage.chart({name: "The squared error of every edge in standard deviations, motions first, loops last", height: 70});
    const toggle = name => value => { settings[name] = value; graph.shake(); };
    stage.check({name: "True loop", key: "t", change: toggle("honest")});
    stage.check({name: "False loop", key: "f", change: toggle("false")});
    stage.check({name: "Robust kernel", key: "r", change: toggle("robust")});
    stage.fold("More");
    stage.button({name: "Start again", key: "n", press: () => graph.reset()});
    stage.slider({name: "Drift of a motion", min: -0.1, max: 0.1, step: 0.005, value: settings.drift, unit: "rad", digits: 3,
                  change: value => { settings.drift = value; graph.reset(); }});
    const nearest = (x, y) => graph.poses.reduce((best, [px, py], k) =>
      (k && Math.hypot(px - x, py - y) < Math.hypot(graph.poses[best][0] - x, graph.poses[best][1] - y) ? k : best), 1);
    const pull = (x, y) => { graph.held.place = [x, y]; graph.shake(); };
    stage.drag(plan, {
      start: (x, y) => { graph.held = {k: nearest(x, y), place: [x, y]}; graph.shake(); },
      move: pull,
      end: () => { graph.held = null; graph.shake(); },
      grab: (x, y) => plan.near(x, y, graph.poses[nearest(x, y)]),
    });
    let chosen = N - 1;
    const choose = by => down => { if (down) { chosen = 1 + ((chosen - 1 + by + N - 1) % (N - 1)); graph.held = null; graph.shake(); } };
    const outwards = down => {
      if (!down) return;
      const [x, y] = graph.held && graph.held.k === chosen ? graph.held.place : graph.poses[chosen], far = Math.hypot(x - 3, y - 3) || 1;
      graph.held = {k: chosen, place: [x + (0.3 * (x - 3)) / far, y + (0.3 * (y - 3)) / far]};
      graph.shake();
    };
    stage.keys(plan, {ArrowLeft: choose(-1), ArrowRight: choose(1), ArrowUp: outwards,
                      ArrowDown: down => { if (down) { graph.held = null; graph.shake(); } }});
    return {
      state: graph, constants: {KERNELS, ITERATIONS, SIGMAS},
      draw() {
        if (!graph.settled) { graph.step(); stage.redraw(); }
        paint(plan, stage.colours, graph, chosen);
        paintStrain(strain, stage.colours, graph);
      },
      describe: () => sentence(graph),
    };
  });

  function paint(plan, colours, graph, chosen) {
    const {poses, truth, edges, weights, held, settings} = graph, flat = path => path.flatMap(([x, y]) => [x, y]);
    plan.clear(colours.free);
    draw.line(plan, flat(truth), colours.muted, {width: 1.5, dash: [4, 4]});
    edges.forEach((edge, k) => {
      const [ax, ay] = poses[edge.i], [bx, by] = poses[edge.j];
      if (!edge.loop) { spring(plan, ax, ay, bx, by, colours.estimate, 1.5, 6, 0.06); return; }
      const content = core.chiSquare(edge, poses) < 12;
      spring(plan, ax, ay, bx, by, content ? colours.clear : colours.hits, 0.75 + 4 * weights[k], 14, 0.12);
    });
    if (held) draw.line(plan, [...poses[held.k].slice(0, 2), ...held.place], colours.highlight, {width: 2, dash: [3, 3]});
    poses.forEach((pose, k) => draw.robot(plan, pose, k === 0 ? colours.ink : colours.estimate,
      {radius: 0.14, fill: held && k === held.k ? colours.highlight : k === 0 ? colours.muted : colours.free}));
    const narrowing = settings.robust && settings.honest | settings.false && !graph.settled;
    plan.write(news(graph) + (narrowing ? ` Width of the kernel: ${graph.width === Infinity ? "infinite" : graph.width}.` : ""));
  }

  /** A zigzag from one place to another. */
  function spring(plan, ax, ay, bx, by, colour, width, turns, aside) {
    const points = [ax, ay], length = Math.hypot(bx - ax, by - ay) || 1, [nx, ny] = [-(by - ay) / length, (bx - ax) / length];
    for (let k = 1; k < 2 * turns; k++) {
      const along = k / (2 * turns), off = k % 2 ? aside : -aside;
      points.push(ax + along * (bx - ax) + off * nx, ay + along * (by - ay) + off * ny);
    }
    draw.line(plan, [...points, bx, by], colour, {width});
  }

  function news(graph) {
    const {settings, error, weights, edges} = graph, off = `${(100 * error).toFixed(0)} cm off`;
    if (!settings.honest && !settings.false) return `As driven: ${off}. Tick <i>True loop</i>: which poses move most?`;
    const wrong = edges.findIndex(edge => edge.name === "false");
    if (wrong >= 0 && weights[wrong] < 0.05) return `The false loop has been let go: ${off}.`;
    if (wrong >= 0) return `A false loop bends it all: ${off}.`;
    return `The loop is shared by all motions: ${off}.`;
  }

  /** A bar for the squared error of every edge, up to 25. */
  function paintStrain(strain, colours, graph) {
    const {edges, poses} = graph, step = strain.width / (N + 1);
    strain.clear(colours.paper);
    edges.forEach((edge, k) => {
      const chi2 = core.chiSquare(edge, poses), height = Math.min(1, Math.sqrt(chi2) / 5) * (strain.height - 4);
      const place = edge.loop ? N - 1 + (edge.name === "false" ? 1 : 0) : k;
      strain.context.fillStyle = edge.loop ? (chi2 < 12 ? colours.clear : colours.hits) : colours.estimate;
      strain.context.fillRect(place * step + 0.1 * step, strain.height - height, 0.8 * step, height);
    });
    strain.write("Strain of each motion, and of the loops (right), in standard deviations up to 5.");
  }

  function sentence(graph) {
    const {edges, poses, weights, error} = graph, loops = edges.map((edge, k) => [edge, k]).filter(([edge]) => edge.loop);
    const words = loops.map(([edge, k]) => `the ${edge.name === "false" ? "false" : "true"} loop is strained by ` +
      `${Math.sqrt(core.chiSquare(edge, poses)).toFixed(1)} standard deviations and counts ${weights[k].toFixed(2)}`);
    return `The path is ${error.toFixed(2)} metres off${words.length ? `; ${words.join("; ")}` : "; no loop is closed"}.`;
  }
})(globalThis);
