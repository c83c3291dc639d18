/* What a search finds, and in which order: a section, chapter or word of the glossary that is called so, then sections
   that speak of it, exercises after explanations, then functions. A place with some of the words is found as well, behind those
   with all of them; the rarer the words, the better. What is for teachers and maintainers comes last. Sphinx reads the query and
   knows the functions; search_sections.js knows the sections. */
const ASKING = new Set("how what why when where which who do does did can should i me my we you need much many get use work".split(" "));
const stem = new Stemmer();
const stems = (text) =>
  (text.toLowerCase().match(/[\p{L}\p{N}]+/gu) ?? [])
    .filter((word) => !stopwords.includes(word))
    .map((word) => stem.stemWord(word));

/* How well a title answers: 100 when it says just the words of the query, less for each further word. */
const titleScore = (wanted, title) => {
  const found = wanted.filter((word) => title.includes(word)).length;
  const begun = wanted.filter((word) => word.length > 3 && title.some((t) => t.startsWith(word))).length;
  if (found === wanted.length) return 55 + (45 * wanted.length) / title.length;
  if (begun === wanted.length) return 45 + (35 * wanted.length) / title.length;
  return found === title.length ? (50 * found) / wanted.length : 0;
};

const shelf = (page) => {
  if (page.startsWith("notebooks/")) return 3;
  if (page === "book/glossary") return 2;
  if (/^book\/(teachers|maintainers|studies|robustness|execution|changelog|bibliography)$/.test(page)) return -20;
  return page.startsWith("book/api") ? -20 : 0;
};

/* The words of a query that tell one place from another, if there are any: "why does my map drift" is about a map that drifts. */
const telling = (query) => {
  const rest = stems(query.replace(/\p{L}+/gu, (word) => (ASKING.has(word.toLowerCase()) ? " " : word)));
  return [...new Set(rest.length ? rest : stems(query))];
};

const ASKED = /^(exercises|test yourself)$/i; // what a chapter asks comes after what it says

const findSections = (query) => {
  const wanted = telling(query), asked = [...new Set(stems(query))];
  if (!wanted.length) return [];
  const counts = wanted.map((word) => {
    const found = new Map();
    for (const [known, places] of Object.entries(SECTIONS.stems))
      if (known === word || (word.length > 3 && known.startsWith(word)))
        for (let i = 0; i < places.length; i += 2) found.set(places[i], (found.get(places[i]) ?? 0) + places[i + 1]);
    return found;
  });
  const rarity = counts.map((found) => Math.log(1 + SECTIONS.places.length / (1 + found.size)));
  const sum = (values) => values.reduce((total, value) => total + value, 0);
  const hits = SECTIONS.places.map(([page, anchor, titles, text], number) => {
    const names = titles.map((title) => stems(title)), best = (some) => Math.max(...names.map((name) => titleScore(some, name)));
    const named = Math.max(best(asked), 0.9 * best(wanted)); // "how to run" is about more than "run"
    const all = stems(titles.join(" "));
    const spoken = counts.map((found, i) => found.get(number) ?? (all.includes(wanted[i]) ? 1 : 0));
    const share = sum(rarity.filter((_, i) => spoken[i] > 0)) / sum(rarity);
    const often = sum(spoken.map((count, i) => (rarity[i] * count) / (count + 3))) / sum(rarity);
    const score = named + 30 * share ** 2 + 20 * often + shelf(page) - (ASKED.test(titles[0]) ? 15 : 0);
    return { page, anchor, title: titles[0], text, share, score, named };
  });
  const some = hits.filter((hit) => hit.named || hit.share > 0.5);
  return some.sort((a, b) => b.score - a.score).slice(0, 60);
};

const findFunctions = (terms) =>
  [...terms]
    .flatMap((term) => Search.performObjectSearch(term, terms).filter((hit) => hit[4] > 5 || term.length > 3))
    .sort((a, b) => b[4] - a[4])
    .slice(0, 10)
    .map(([page, title, anchor, text, score]) => ({ page, title, anchor: anchor.slice(1), text, score, code: true }));

var Scorer = { objNameMatch: 11, objPartialMatch: 2, objPrio: { 0: 0, 1: 0, 2: -5 }, objPrioDefault: 0 };

Search.query = (query) => {
  const [, , , marked, terms] = Search._parseQuery(query);
  const functions = findFunctions(terms);
  const meant = functions.filter((hit) => query.includes("_") && hit.score >= Scorer.objNameMatch - 5);
  const found = [...meant, ...findSections(query), ...functions.filter((hit) => !meant.includes(hit))];
  for (const hit of found) {
    const item = Search.output.appendChild(document.createElement("li"));
    const link = item.appendChild(document.createElement("a"));
    link.href = hit.page + DOCUMENTATION_OPTIONS.LINK_SUFFIX + (hit.anchor ? `#${hit.anchor}` : "");
    link.textContent = hit.title;
    const page = SECTIONS.pages[hit.page];
    if (!hit.code && page !== hit.title) item.appendChild(document.createElement("span")).textContent = ` ${page}`;
    const context = item.appendChild(document.createElement("p"));
    context.className = "context";
    context.textContent = hit.text;
    marked.forEach((word) => _highlightText(context, word, "highlighted"));
  }
  _finishSearch(found.length);
  Search.status.textContent = found.length ? `${found.length} places, the likeliest first.` : "Nothing is called so here. Try another word.";
};
