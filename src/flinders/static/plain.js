/** What a report does without a 3-D view: light or dark, and copying. */

/** @typedef {import("./views/colours.js").Theme} Theme */

/**
 * Let a button change the theme. Nothing is remembered: a report is a file, and leaves nothing behind.
 *
 * @param {(theme: Theme) => void} changed
 * @returns {() => Theme}  which one it is now
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

/** Let each button beside a listing copy it; where a browser refuses, the text is marked, to be copied by hand. */
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
                button.textContent = "Marked: press Ctrl+C";
            }
            setTimeout(() => (button.textContent = "Copy"), 2500);
        });
    }
}
