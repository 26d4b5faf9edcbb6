/**
 * Script of the page of an online calibration: reloads the page, shows its age, and stores theme and span in its address,
 * so that a reload keeps them.
 */

import { theming } from "../../static/plain.js";

const kept = new URLSearchParams(location.hash.slice(1));

/** @param {string} name @param {string} value */
function keep(name, value) {
    kept.set(name, value);
    history.replaceState(null, "", `#${kept}`);
}

const theme = theming((chosen) => keep("theme", chosen));
if (["light", "dark"].includes(kept.get("theme") ?? "") && kept.get("theme") !== theme()) {
    document.getElementById("theme")?.click();
}

for (const choice of document.querySelectorAll("input[name=span]")) {
    if (!(choice instanceof HTMLInputElement)) continue;
    if (choice.value === kept.get("span")) choice.checked = true;
    choice.addEventListener("change", () => keep("span", choice.value));
}

const age = document.getElementById("age");
const { written, every } = age?.dataset ?? {};
if (age && written && every) {
    const old = document.getElementById("old");
    const seconds = () => Math.max(0, Math.round(Date.now() / 1000 - Number(written)));
    const say = () => {
        age.textContent = `written ${seconds()} s ago · `;
        if (old) old.hidden = seconds() < 3 * Number(every) + 30;
    };
    say();
    setInterval(say, 1000);
    setTimeout(() => location.reload(), 1000 * Math.min(Math.max(Number(every), 5), 30));
}
