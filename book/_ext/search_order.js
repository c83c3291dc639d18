/* The order of what a search finds: chapters, then what one looks up, then what is for teachers and maintainers. */
var Scorer = {
  objNameMatch: 11,
  objPartialMatch: 2,
  objPrio: { 0: 0, 1: 0, 2: -5 },
  objPrioDefault: 0,
  title: 15,
  partialTitle: 7,
  term: 5,
  partialTerm: 2,
  score: ([page, , , , score]) => {
    if (page.startsWith("notebooks/")) return score + 4;
    if (/^book\/(glossary|bibliography)$/.test(page)) return Math.min(score, 8); // an entry of the index counts 100
    return /^book\/(teachers|maintainers|studies|robustness|execution|changelog)$/.test(page) ? score - 4 : score;
  },
};
