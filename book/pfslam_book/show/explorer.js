(function () {
  "use strict";
  var root = document.currentScript.parentElement;
  var data = JSON.parse(root.querySelector('script[type="application/json"]').textContent);
  var image = root.querySelector("img"), status = root.querySelector('[role="status"]');
  var button = root.querySelector("button"), timer = null;
  var calm = window.matchMedia("(prefers-reduced-motion: reduce)").matches;

  // A control is {at, set, last}: the stop where it stands, a way to move it, and its last stop.
  function slider(input, k) {
    var places = data.places[k], output = root.querySelector('output[for="' + input.id + '"]');
    var self = {at: data.start[k], last: places.length - 1, set: function (stop) {
      self.at = Math.max(0, Math.min(self.last, stop));
      input.value = places[self.at];
      input.dataset.stop = self.at;
      output.textContent = data.labels[k][self.at];
      input.setAttribute("aria-valuetext", data.labels[k][self.at]);
    }};
    function nearest() {
      var best = 0;
      places.forEach(function (place, stop) {
        if (Math.abs(place - input.value) < Math.abs(places[best] - input.value)) best = stop;
      });
      return best;
    }
    input.addEventListener("input", function () { moved(k, nearest()); });
    var before = 0;  // a finger that scrolls the page across a slider leaves it where it was
    input.addEventListener("pointerdown", function () { before = self.at; });
    input.addEventListener("pointercancel", function () { if (self.at !== before) moved(k, before); });
    input.addEventListener("keydown", function (event) {
      var step = {ArrowRight: 1, ArrowUp: 1, ArrowLeft: -1, ArrowDown: -1, PageUp: 1, PageDown: -1,
                  Home: -self.last, End: self.last}[event.key];
      if (step === undefined || event.altKey || event.ctrlKey || event.metaKey) return;
      event.preventDefault();
      moved(k, self.at + step);
    });
    return self;
  }
  function choice(fieldset, k) {
    var radios = Array.from(fieldset.querySelectorAll("input"));
    var self = {at: data.start[k], last: radios.length - 1, set: function (stop) {
      self.at = Math.max(0, Math.min(self.last, stop));
      radios[self.at].checked = true;
      fieldset.dataset.stop = self.at;
    }};
    radios.forEach(function (radio, stop) {
      radio.addEventListener("change", function () { moved(k, stop); });
    });
    return self;
  }
  var controls = Array.from(root.querySelectorAll('input[type="range"], fieldset')).map(function (element, k) {
    return element.matches("fieldset") ? choice(element, k) : slider(element, k);
  });
  var player = controls[data.play];

  function dark() { return document.documentElement.dataset.theme === "dark" && data.nights[0]; }
  function fetch_frames() {  // files of their own, fetched before the pictures move
    (dark() ? data.nights : data.frames).forEach(function (address) { new Image().src = address; });
  }
  ["pointerenter", "focusin", "touchstart"].forEach(function (near) {
    root.addEventListener(near, fetch_frames, {once: true, passive: true});
  });
  function show() {
    var state = data.states[controls.map(function (control) { return control.at; }).join()];
    image.dataset.day = data.frames[state[0]];
    image.dataset.night = data.nights[state[0]];
    image.src = dark() ? image.dataset.night : image.dataset.day;
    image.alt = data.alts[state[1]];
  }
  function move(k, stop) {
    if (data.alone) {  // this page holds frames for one control away from its start at a time
      controls.forEach(function (control, other) { if (other !== k) control.set(data.start[other]); });
    }
    controls[k].set(stop);
    show();
  }
  function moved(k, stop) {  // by the reader
    stop_playing();
    move(k, stop);
    status.textContent = image.alt;
  }
  function stop_playing() {
    clearInterval(timer);
    timer = null;
    if (button) button.textContent = calm ? "Next" : "Play";
  }
  function step() {
    move(data.play, player.at + 1);
    if (timer === null) status.textContent = image.alt;
    if (player.at === player.last) stop_playing();
  }
  if (button) {
    button.addEventListener("click", function () {
      if (timer !== null) { stop_playing(); return; }
      if (player.at === player.last) { move(data.play, 0); if (calm) return; }
      if (calm) { step(); return; }
      button.textContent = "Pause";
      timer = setInterval(step, data.pause);
    });
    button.hidden = false;
    stop_playing();
  }
  controls.forEach(function (control, k) { control.set(data.start[k]); });
  show();
})();
