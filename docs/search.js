// Search in the index that the build writes as a script. It works from a disk, too.
(function () {
  "use strict";
  const field = document.getElementById("mkdocs-search-query");
  const list = document.getElementById("mkdocs-search-results");
  if (!field || !list) return;
  const MOST = 40;
  const CONTEXT = 90;

  function wordsOf(text) {
    return text.toLowerCase().split(/[^\p{L}\p{N}_.-]+/u).filter(Boolean);
  }

  // all words must occur; a word in a title counts more than one in the text
  function scoreOf(entry, words) {
    const title = entry.title.toLowerCase();
    const text = entry.text.toLowerCase();
    let score = 0;
    for (const word of words) {
      const inTitle = title.includes(word);
      const inText = text.split(word).length - 1;
      if (!inTitle && !inText) return 0;
      score += (inTitle ? 20 : 0) + (title === word ? 20 : 0) + Math.min(inText, 5);
    }
    return score;
  }

  function excerptOf(text, word) {
    const at = Math.max(text.toLowerCase().indexOf(word), 0);
    const start = Math.max(at - CONTEXT, 0);
    const end = Math.min(at + CONTEXT, text.length);
    return (start ? "… " : "") + text.slice(start, end) + (end < text.length ? " …" : "");
  }

  function show() {
    const words = wordsOf(field.value);
    list.replaceChildren();
    const found = words.length
      ? window.searchIndex
          .map((entry) => ({ entry, score: scoreOf(entry, words) }))
          .filter((one) => one.score)
          .sort((a, b) => b.score - a.score)
          .slice(0, MOST)
      : [];
    for (const { entry } of found) {
      const item = document.createElement("article");
      const head = document.createElement("h3");
      const link = document.createElement("a");
      const text = document.createElement("p");
      link.href = base_url.replace(/\/$/, "") + "/" + entry.location;
      link.textContent = entry.title;
      text.textContent = excerptOf(entry.text, words[0]);
      head.append(link);
      item.append(head, text);
      list.append(item);
    }
    if (words.length && !found.length) list.textContent = "No results.";
  }

  const script = document.createElement("script");
  script.src = base_url.replace(/\/$/, "") + "/search/search_index.js";
  script.onload = function () {
    field.value = new URLSearchParams(location.search).get("q") || "";
    field.addEventListener("input", show);
    show();
  };
  document.head.append(script);
})();
