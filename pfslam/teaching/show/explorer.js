(function () {
  "use strict";
  var root = document.currentScript.parentElement;
  var data = JSON.parse(root.querySelector('script[type="application/json"]').textContent);
  var sliders = Array.from(root.querySelectorAll('input[type="range"]'));
  var image = root.querySelector("img"), status = root.querySelector('[role="status"]');
  var button = root.querySelector("button"), player = sliders[data.play], timer = null;
  var calm = window.matchMedia("(prefers-reduced-motion: reduce)").matches;

  function show(moved) {
    if (data.alone && moved) {  // this page holds frames for one slider away from its start at a time
      sliders.forEach(function (slider, k) { if (slider !== moved) slider.value = data.start[k]; });
    }
    sliders.forEach(function (slider, k) {
      var text = data.labels[k][slider.value];
      slider.setAttribute("aria-valuetext", text);
      root.querySelector('output[for="' + slider.id + '"]').textContent = text;
    });
    var state = data.states[sliders.map(function (slider) { return slider.value; }).join()];
    image.src = data.frames[state[0]];
    image.alt = data.alts[state[1]];
    if (moved && timer === null) status.textContent = image.alt;
  }
  function stop() {
    clearInterval(timer);
    timer = null;
    if (button) button.textContent = calm ? "Next" : "Play";
  }
  function step() {
    player.value = Number(player.value) + 1;
    show(player);
    if (player.value === player.max) stop();
  }
  sliders.forEach(function (slider) {
    slider.addEventListener("input", function () { stop(); show(slider); });
  });
  if (button) {
    button.addEventListener("click", function () {
      if (timer !== null) { stop(); return; }
      if (player.value === player.max) { player.value = player.min; show(player); if (calm) return; }
      if (calm) { step(); return; }
      button.textContent = "Pause";
      timer = setInterval(step, data.pause);
    });
    button.hidden = false;
    stop();
  }
  show(null);
})();
