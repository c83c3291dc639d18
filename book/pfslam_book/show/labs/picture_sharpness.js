/* How sharp should a likelihood be (chapter 04): the weights of a cloud whose scans fit more or less well. */
(function (root) {
  "use strict";
  const {core, draw, picture} = root.pfslam;
  const LOGS = {"-4": "0.0001", "-2": "0.01", "0": "1"};

  picture("sharpness", ({cloud, shares}) => ({
    label: "The particles of a cloud, each as large as its weight, and their weights in order",
    controls: {sharpness: {name: "Sharpness B of a scan", min: 0, max: 1000, step: 1, value: 54, digits: 0}},
    compute({sharpness}) {
      const logs = shares.map(share => sharpness * share), total = core.logSumExp(logs), n = shares.length;
      const weights = logs.map(log => Math.exp(log - total)), nEff = core.effectiveSampleSize(weights), heaviest = Math.max(...weights);
      const inOrder = [...weights].sort((a, b) => b - a);
      const circles = {
        title: `N_eff = ${nEff.toFixed(1)} of ${n}`, x: [-8, 8], y: [-8, 8], equal: true, xName: "x [cm]", yName: "y [cm]",
        paint(pen, colours) {
          draw.dots(pen, cloud, colours.muted, 1.5);
          pen.context.globalAlpha = 0.6;
          draw.dots(pen, cloud, colours.particles, weights.map(weight => Math.min(0.25 * pen.scale * Math.sqrt(n * weight), 26)));
          Object.assign(pen.context, {strokeStyle: colours.estimate, lineWidth: 0.75});  // a rim tells neighbours apart
          pen.context.stroke();
          pen.context.globalAlpha = 1;
        },
      };
      const order = {
        title: `heaviest: ${heaviest.toFixed(2)}`, x: [0, n], y: [-5, 0.2], xName: "particle, heaviest first", yName: "weight", yTicks: LOGS,
        paint(pen, colours) {
          const tops = inOrder.flatMap((weight, k) => [k, -9, k, Math.max(-9, Math.log10(weight))]);
          draw.line(pen, tops, colours.particles, {width: 1 + pen.scale, gaps: true});
        },
      };
      return {panels: [circles, order], weights, words: `Weights exp(${sharpness} times share) of ${n} particles: the effective ` +
        `number is ${nEff.toFixed(1)}, the heaviest particle has ${heaviest.toFixed(3)} of all weight.`};
    },
  }));
})(globalThis);
