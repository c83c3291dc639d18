/* "Predict first": the page takes the prediction, keeps it on the reader's machine, and shows it beside the next output.
 * Until then, or until the reader skips, that output and the words about it are folded away. A laboratory tells nothing by itself.
 * Where the output is a picture with `data-sketch`, the reader draws a curve on its axes (`sketch.js`). */
(function () {
  "use strict";
  const ASKS = "Predict first", LIVE = ".pfslam-lab, .pfslam-explorer";

  /* The reader's machine, or nothing where it keeps nothing for us. */
  function memory() {
    try {
      localStorage.setItem("pfslam-test", "1");
      localStorage.removeItem("pfslam-test");
      return localStorage;
    } catch {
      return null;
    }
  }

  function element(name, attributes, ...children) {
    const made = document.createElement(name);
    for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
    made.append(...children);
    return made;
  }

  /* The answers between which a question lets one choose, or none. */
  function choices(question) {
    const three = question.match(/([\w.]+), ([\w.]+),? or ([\w. ]+)\?$/), two = question.match(/, (the \w+) or (the \w+)\?$/);
    if (three || two) return (three || two).slice(1);
    const alone = question.indexOf("?") === question.length - 1;
    return alone && /^(will|do|does|is|are|can)\b/i.test(question) ? ["yes", "no"] : [];
  }

  /* What is asked after the bold words, up to the last question mark. */
  function questionOf(bold) {
    let words = "";
    for (let next = bold.nextSibling; next; next = next.nextSibling) words += next.textContent;
    words = words.replace(/\s+/g, " ").trim();
    return words.slice(0, words.lastIndexOf("?") + 1) || words;
  }

  function outputAfter(place) {
    return [...document.querySelectorAll("article .cell_output")].find(output =>
      place.compareDocumentPosition(output) & Node.DOCUMENT_POSITION_FOLLOWING && !output.closest("details"));
  }

  /* An output and what is said about it, up to the next cell, heading or prediction. */
  function resultAt(output) {
    if (!output || output.querySelector(LIVE)) return [];
    const parts = [output], asks = part => [...part.querySelectorAll("strong")].some(bold => bold.textContent.startsWith(ASKS));
    for (let next = output.closest(".cell").nextElementSibling; next; next = next.nextElementSibling) {
      if (next.matches(".cell, section") || asks(next)) break;
      parts.push(next);
    }
    return parts;
  }

  /* What takes the answer: a choice, a line to write on, or the axes of the picture that shows the result. */
  function chooser(options, id) {
    const set = element("fieldset", {}, element("legend", {}, "Your prediction"));
    for (const answer of options) {
      set.append(element("label", {}, element("input", {type: "radio", name: id, value: answer, required: ""}), ` ${answer}`));
    }
    const buttons = [...set.querySelectorAll("input")];
    return {
      parts: [set],
      read: () => buttons.find(button => button.checked)?.value || "",
      write: answer => buttons.forEach(button => { button.checked = button.value === answer; }),
    };
  }

  function writer(question, id) {
    const kind = /^how (many|often|much|far)\b/i.test(question) ? {inputmode: "decimal"} : {};
    const line = element("input", {type: "text", id, name: id, maxlength: "200", required: "", ...kind});
    return {
      parts: [element("label", {for: id}, "Your prediction"), line],
      read: () => line.value.trim(),
      write: answer => { line.value = answer; },
    };
  }

  function keep(store, key, answer) {
    try {
      store.setItem(key, answer);
      return true;
    } catch {
      return false;
    }
  }

  function ask(bold, number, store) {
    const place = bold.closest("p"), key = `pfslam:${location.pathname.split("/").pop()}:prediction-${number}`;
    const question = questionOf(bold), options = choices(question), id = `pfslam-prediction-${number}`;
    const output = outputAfter(place), picture = output?.querySelector("img[data-sketch]");
    if (picture) {
      askForSketch(output, picture, key, store);
      return;
    }
    const field = options.length ? chooser(options, id) : writer(question, id);
    const told = element("p", {role: "status", class: "pfslam-kept"});
    const skip = element("button", {type: "button"}, "Skip"), result = store.getItem(key) ? [] : resultAt(output);
    const unfold = () => { result.forEach(part => part.classList.remove("pfslam-waits")); skip.remove(); };
    result.forEach(part => part.classList.add("pfslam-waits"));
    skip.addEventListener("click", () => {
      unfold();
      told.textContent = "The result is below.";
    });
    const form = element("form", {class: "pfslam-predict", autocomplete: "off"}, ...field.parts,
                         element("button", {type: "submit"}, "Keep it"), ...(result.length ? [skip] : []), told);
    if (result.length) told.textContent = "The result waits for your prediction.";
    place.after(form);
    const said = element("p", {class: "pfslam-said"});
    const show = answer => {
      said.replaceChildren("You said: ", element("strong", {}, answer));
      if (output) output.prepend(said);
    };
    form.addEventListener("submit", event => {
      event.preventDefault();
      const answer = field.read();
      if (!answer || !keep(store, key, answer)) return;
      unfold();
      show(answer);
      told.textContent = output ? "Kept: it stands beside the next output." : "Kept.";
    });
    const kept = store.getItem(key);
    if (!kept) return;
    field.write(kept);
    show(kept);
  }

  /* The picture itself takes the prediction: it shows its axes, and below it stands the form; the words about it are folded. */
  function askForSketch(output, picture, key, store) {
    const words = resultAt(output).slice(1), sketch = globalThis.pfslamSketch(picture);
    const told = element("p", {role: "status", class: "pfslam-kept"});
    const submit = element("button", {type: "submit"}, "Keep it"), skip = element("button", {type: "button"}, "Skip");
    const again = element("button", {type: "button"}, "Draw it anew");
    const form = element("form", {class: "pfslam-predict"}, submit, skip, again, told);
    const wait = (on, message) => {
      sketch.cover(on);
      words.forEach(part => part.classList.toggle("pfslam-waits", on));
      [submit.hidden, skip.hidden, again.hidden] = [!on, !on, on];
      told.textContent = message;
    };
    const begin = () => wait(true, "Draw your curve on the axes, by hand or with the arrow keys. The result waits for it.");
    skip.addEventListener("click", () => {
      sketch.write("");
      wait(false, "The result is in the picture.");
    });
    again.addEventListener("click", () => {
      store.removeItem(key);
      sketch.write("");
      begin();
    });
    form.addEventListener("submit", event => {
      event.preventDefault();
      const curve = sketch.read();
      if (!curve) told.textContent = "Draw a curve first, from one side of the axes to the other.";
      else if (keep(store, key, curve)) wait(false, "Kept: your curve is the thick dashed one in the picture.");
    });
    output.closest(".cell").after(form);
    if (sketch.write(store.getItem(key))) wait(false, "Your curve is the thick dashed one in the picture.");
    else begin();
  }

  const store = memory();
  if (!store) return;
  [...document.querySelectorAll("article p > strong")].filter(bold => bold.textContent.startsWith(ASKS)).forEach(
    (bold, number) => ask(bold, number, store));
})();
