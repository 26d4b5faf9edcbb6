/** Functions of a report without a 3-D view: light and dark theme, and copying. */

/** @typedef {import("./views/colours.js").Theme} Theme */

/**
 * Let a button change the theme, without storage.
 *
 * @param {(theme: Theme) => void} changed
 * @returns {() => Theme}  returns the present theme
 */
export function theming(changed) {
    const dark = matchMedia("(prefers-color-scheme: dark)");
    /** @type {Theme | null} */
    let chosen = null;
    const theme = () => chosen ?? (dark.matches ? "dark" : "light");
    document.getElementById("theme")?.addEventListener("click", () => {
        chosen = theme() === "dark" ? "light" : "dark";
        document.documentElement.dataset.theme = chosen;
        changed(chosen);
    });
    dark.addEventListener("change", () => changed(theme()));
    document.documentElement.classList.add("scripted");
    return theme;
}

/** Let the button of each listing copy it; if the browser refuses, the text is selected for manual copying. */
export function copying() {
    for (const button of document.querySelectorAll("button.copy")) {
        const listing = button.closest(".listing")?.querySelector("pre");
        if (!listing) continue;
        button.addEventListener("click", async () => {
            try {
                await navigator.clipboard.writeText(listing.textContent ?? "");
                button.textContent = "Copied";
            } catch {
                getSelection()?.selectAllChildren(listing);
                button.textContent = "Selected: press Ctrl+C";
            }
            setTimeout(() => (button.textContent = "Copy"), 2500);
        });
    }
}
