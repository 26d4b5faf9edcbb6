// Sets the theme before the first paint: what was chosen here last time, else what the system asks for.
// A classic script on purpose: a module would run after the page has been drawn once in the wrong colours.
(function () {
    let chosen = null;
    try {
        chosen = localStorage.getItem("flinders-theme");
    } catch {
        // Storage may be switched off; the system's choice holds then.
    }
    const dark = window.matchMedia("(prefers-color-scheme: dark)").matches;
    document.documentElement.dataset.theme = chosen === "dark" || chosen === "light" ? chosen : dark ? "dark" : "light";
})();
