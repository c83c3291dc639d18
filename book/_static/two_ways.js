/* Two ways to read a chapter: the switch in the head of the page, and the sections that Story folds.
 * What a link leads to is opened; if Story leaves it out, this page turns to Workshop until it is left. */
(function () {
  "use strict";
  const root = document.documentElement, KEY = "pfslam:read", WAYS = ["Story", "Workshop"];
  const buttons = new Map();

  function read() {
    return root.dataset.read === "story" ? "Story" : "Workshop";
  }

  function remember(way) {
    try {
      localStorage.setItem(KEY, way.toLowerCase());
    } catch {
      // a machine that keeps nothing for us asks again on the next page
    }
  }

  function shown(part) {
    return part.getClientRects().length > 0;
  }

  /* The theme looks only at a new size for code that scrolls, in which one must be able to stand by the keyboard. */
  function laidOut() {
    window.dispatchEvent(new Event("resize"));
  }

  /* Turn to a way, and keep what stands at the top of the window where it is. */
  function turn(way) {
    const blocks = [...document.querySelectorAll("article section > :not(section)")];
    const first = blocks.findIndex(block => shown(block) && block.getBoundingClientRect().bottom > 80);
    const places = blocks.map(block => block.getBoundingClientRect().top);
    if (way === "Story") root.dataset.read = "story";
    else delete root.dataset.read;
    buttons.forEach((button, name) => button.setAttribute("aria-pressed", String(name === way)));
    laidOut();
    for (let k = first; k > 0; k--) {
      if (!shown(blocks[k])) continue;
      window.scrollBy({top: blocks[k].getBoundingClientRect().top - Math.max(places[k], 0), behavior: "instant"});
      break;
    }
  }

  function open(section, on) {
    section.classList.toggle("pfslam-open", on);
    section.querySelector(":scope > :is(h2, h3) > .pfslam-unfold").setAttribute("aria-expanded", String(on));
    laidOut();
  }

  /* What the address names: an element by its id, or a laboratory, as `#lab=cells-2&particles=77`. */
  function named() {
    const hash = decodeURIComponent(location.hash.slice(1)), lab = /^lab=([a-z_]+)(?:-(\d+))?/.exec(hash);
    if (!lab) return hash ? document.getElementById(hash) : null;
    return document.querySelectorAll(`figure.pfslam-lab[data-lab="${lab[1]}"]`)[(lab[2] || 1) - 1];
  }

  function words(heading) {
    const whole = heading.cloneNode(true);
    whole.querySelector(".headerlink")?.remove();
    return whole.textContent.trim();
  }

  function arrive() {
    const goal = named();
    if (read() !== "Story" || !goal) return;
    let moved = false;
    for (let section = goal.closest(".pfslam-aside"); section; section = section.parentElement.closest(".pfslam-aside")) {
      moved ||= !section.classList.contains("pfslam-open");
      open(section, true);
    }
    if (getComputedStyle(goal).visibility === "hidden") {
      moved = true;
      turn("Workshop");
    }
    if (!moved) return;
    const come = () => goal.scrollIntoView({behavior: "instant"});
    come();
    if (document.readyState !== "complete") window.addEventListener("load", come, {once: true}); // pictures push it down
  }

  const head = document.querySelector(".article-header-buttons");
  if (!head) return;
  const group = document.createElement("div");
  group.className = "pfslam-ways";
  group.setAttribute("role", "group");
  group.setAttribute("aria-label", "Way to read this book");
  for (const way of WAYS) {
    const button = document.createElement("button");
    button.type = "button";
    button.textContent = way;
    button.title = way === "Story" ? "The argument, without code" : "Everything, with code and exercises";
    button.addEventListener("click", () => {
      turn(way);
      remember(way);
    });
    buttons.set(way, button);
    group.append(button);
  }
  head.prepend(group);
  for (const section of document.querySelectorAll("section.pfslam-aside")) {
    const heading = section.querySelector(":scope > :is(h2, h3)"), button = document.createElement("button");
    button.type = "button";
    button.className = "pfslam-unfold";
    button.setAttribute("aria-expanded", "false");
    button.setAttribute("aria-label", `Read also: ${words(heading)}`);
    button.addEventListener("click", () => open(section, !section.classList.contains("pfslam-open")));
    heading.append(button);
  }
  buttons.forEach((button, name) => button.setAttribute("aria-pressed", String(name === read())));
  window.addEventListener("hashchange", arrive);
  document.addEventListener("click", event => {
    if (event.target.closest?.('a[href*="#"]')) setTimeout(arrive);
  });
  arrive();
})();
