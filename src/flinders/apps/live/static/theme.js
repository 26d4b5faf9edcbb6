// Sets the theme before the first paint: the last choice, else the system's setting.
// A classic script on purpose: a module would run after the page has been drawn once in the wrong colours.
(function () {
    let chosen = null;
    try {
        chosen = localStorage.getItem("flinders-theme");
    } catch {
        // Without storage, the system's setting applies.
    }
    const dark = window.matchMedia("(prefers-color-scheme: dark)").matches;
    document.documentElement.dataset.theme = chosen === "dark" || chosen === "light" ? chosen : dark ? "dark" : "light";
})();
