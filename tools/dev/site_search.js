// Search of the site: every word must stand in a section; titles count more. The index is a script, so that the pages
// also work from their files, where a browser refuses to fetch.
(() => {
  const MOST = 30, AROUND = 110;
  // What a reader asks first is told by the guide and the reference; tables of measurements come last.
  const WEIGHTS = [[/^(guide|reference|index|api)/, 2], [/^evidence/, 0.5]];

  const escape = (text) => text.replace(/[&<>"]/g, (c) => `&#${c.charCodeAt(0)};`);

  function score(words, [location, title, text]) {
    const heading = title.toLowerCase(), body = text.toLowerCase();
    let sum = 0;
    for (const word of words) {
      const times = body.split(word).length - 1;
      const named = heading === word ? 12 : heading.includes(word) ? 8 : 0;
      if (!times && !named) return 0;
      sum += named + Math.log(1 + times);
    }
    const kind = WEIGHTS.find(([pattern]) => pattern.test(location));
    return sum * (kind ? kind[1] : 1);
  }

  function excerpt(words, text) {
    const plain = text.replace(/<[^>]*>/g, " ").replace(/\s+/g, " ");
    const at = Math.max(0, ...words.map((word) => plain.toLowerCase().indexOf(word)));
    const from = Math.max(0, at - AROUND);
    return (from ? "… " : "") + plain.slice(from, at + 2 * AROUND) + (at + 2 * AROUND < plain.length ? " …" : "");
  }

  const pageOf = ([location]) => location.replace(/#.*/, "");

  /** Of every page the section that answers best; the page's own entry, which has all of its text, counts by title. */
  function best(words) {
    const pages = new Map();
    for (const entry of window.siteIndex) {
      const page = pageOf(entry), counts = entry[0].includes("#") || entry[1].toLowerCase().includes(words[0]);
      const value = score(words, entry) * (counts ? 1 : 0.3);
      if (value > (pages.has(page) ? pages.get(page)[0] : 0)) pages.set(page, [value, entry]);
    }
    return [...pages.values()].sort((a, b) => b[0] - a[0]).slice(0, MOST).map(([, entry]) => entry);
  }

  function show(query) {
    const words = query.toLowerCase().split(/\s+/).filter((word) => word.length > 1);
    const titles = new Map(window.siteIndex.filter(([location]) => !location.includes("#"))
      .map(([location, title]) => [location, title]));
    document.getElementById("mkdocs-search-results").innerHTML = (words.length ? best(words) : []).map((entry) => {
      const [location, title, text] = entry, page = titles.get(pageOf(entry)) || title;
      return `<article><h3><a href="${base_url}/${escape(location)}">${escape(page)}</a></h3>` +
        `<p>${title === page ? "" : `<b>${escape(title)}</b> `}${escape(excerpt(words, text))}</p></article>`;
    }).join("") || "<p>No page has all of these words.</p>";
  }

  const input = document.getElementById("mkdocs-search-query");
  if (!input) return;
  const script = document.createElement("script");
  script.src = base_url + "/search/index.js";
  script.onload = () => {
    input.value = new URLSearchParams(window.location.search).get("q") || "";
    input.addEventListener("input", () => show(input.value));
    if (input.value) show(input.value);
  };
  document.head.appendChild(script);
})();
