/* What a search finds, and in which order: a section, chapter or word of the glossary that is called so, then sections
   that speak of it, then functions. What is for teachers and maintainers comes last. Sphinx reads the query and knows the
   functions; search_sections.js knows the sections. */
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

const findSections = (query) => {
  const wanted = [...new Set(stems(query))];
  if (!wanted.length) return [];
  const counts = wanted.map((word) => {
    const found = new Map();
    for (const [known, places] of Object.entries(SECTIONS.stems))
      if (known === word || (word.length > 3 && known.startsWith(word)))
        for (let i = 0; i < places.length; i += 2) found.set(places[i], (found.get(places[i]) ?? 0) + places[i + 1]);
    return found;
  });
  const hits = SECTIONS.places.map(([page, anchor, titles, text], number) => {
    const named = Math.max(...titles.map((title) => titleScore(wanted, stems(title))));
    const all = stems(titles.join(" "));
    const spoken = counts.map((found, i) => found.get(number) ?? (all.includes(wanted[i]) ? 1 : 0));
    const whole = spoken.every((count) => count > 0);
    const often = spoken.reduce((sum, count) => sum + count / (count + 3), 0) / wanted.length;
    return { page, anchor, title: titles[0], text, whole, score: named + 20 * often + shelf(page), named };
  });
  const whole = hits.filter((hit) => hit.whole || hit.named);
  const some = whole.length ? whole : hits.filter((hit) => hit.score - shelf(hit.page) > 0);
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
