// The version under the site's name. Where sites of several versions lie side by side (./dev site --into FOLDER) it is a
// choice that leads to the same page of another one, or to its first page where that version does not have the page.
// The list of versions is a script with the pages that each has, so that this also works from files.
(() => {
  const { here, all } = window.siteVersions;
  const place = document.querySelector(".wy-side-nav-search");
  if (!place) return;
  const shown = document.createElement("div");
  shown.className = "site-version";
  place.insertBefore(shown, place.children[1] || null);
  if (all.length < 2) {
    shown.textContent = here;
    return;
  }
  const choice = document.createElement("select");
  choice.setAttribute("aria-label", "version of tiller");
  for (const { version } of all) choice.add(new Option(version, version, false, version === here));
  choice.addEventListener("change", () => {
    const root = new URL(base_url + "/", location.href);
    const page = location.href.slice(root.href.length).replace(/[?#].*/, "") || "index.html";
    const there = all.find(({ version }) => version === choice.value);
    location.href = new URL(`../${choice.value}/${there.pages.includes(page) ? page : "index.html"}`, root).href;
  });
  shown.append(choice);
})();
