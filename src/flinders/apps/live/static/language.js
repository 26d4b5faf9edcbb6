/**
 * Words of the page in the user's language.
 *
 * English phrases are in the code: `phrase("phase.good", "Good")`. Another language is a file, `languages/CODE.json`, with
 * a sentence for each key; a key that it lacks stays English. The page loads that file before it draws anything. Workers
 * and files that the page saves stay English: sentences are made where they are shown.
 */

import { element, recall, remember, setText } from "./dom.js";

/** Key of the chosen language in the browser's storage. */
const KEY = "flinders-language";
const ENGLISH = "en";
/** Matches bold words and code in a phrase. */
const MARKED = /(\*\*[^*]+\*\*|`[^`]+`)/;
/** Attributes with words, each with the attribute that holds the key of its phrase. @type {[string, string][]} */
const ATTRIBUTES = [["title", "data-phrase-title"], ["aria-label", "data-phrase-label"], ["placeholder", "data-phrase-placeholder"]];

/** @type {{code: string, words: Readonly<Record<string, string>>}} */
let language = { code: ENGLISH, words: {} };

/** @returns {string} Code of the language that the page is in. */
export function languageCode() {
    return language.code;
}

/**
 * Set the language of the page.
 * @param {string} code
 * @param {Readonly<Record<string, string>>} words  by key
 */
export function useLanguage(code, words) {
    language = { code, words };
}

/**
 * Make a text in English, such as a file to save, whatever the language of the page.
 * @template T
 * @param {() => T} make
 * @returns {T}
 */
export function inEnglish(make) {
    const before = language;
    language = { code: ENGLISH, words: {} };
    try {
        return make();
    } finally {
        language = before;
    }
}

/**
 * A phrase in the page's language, with values in place of the names in braces.
 * @param {string} key
 * @param {string} english
 * @param {Readonly<Record<string, string | number>>} [values]
 * @returns {string}
 */
export function phrase(key, english, values = {}) {
    return (language.words[key] ?? english).replace(/\{(\w+)\}/g, (whole, name) => String(values[name] ?? whole));
}

/**
 * The translation of a phrase, with its braces not yet filled; null in English and without a translation.
 * @param {string} key
 * @returns {string | null}
 */
export function translation(key) {
    return language.words[key] ?? null;
}

/**
 * A count with its noun, in the language's form for that count; null in English and without a translation.
 * @param {string} key  of the forms: `.one`, `.other` and what else the language has
 * @param {number} count
 * @returns {string | null}
 */
export function pluralForm(key, count) {
    const { code, words } = language;
    return words[`${key}.${new Intl.PluralRules(code).select(count)}`] ?? words[`${key}.other`] ?? null;
}

/**
 * A number in text, such as "1,234.5", with the decimal and group signs of the page's language.
 * @param {string} text
 * @returns {string}
 */
export function numeral(text) {
    if (language.code === ENGLISH) return text;
    const parts = new Intl.NumberFormat(language.code).formatToParts(12345.6);
    const signOf = (/** @type {string} */ type) => parts.find((part) => part.type === type)?.value ?? "";
    const whole = text.replace(/[.,](?=\d)/g, (sign) => signOf(sign === "." ? "decimal" : "group"));
    return whole.replace(/(?<=\d)%/g, phrase("number.percent", "%"));
}

/**
 * Translate the words of all elements of a part of the page that name a phrase.
 * @param {ParentNode} root
 */
export function translateFixed(root) {
    if (language.code === ENGLISH) return;
    for (const host of root.querySelectorAll("[data-phrase]")) {
        const words = translation(host.getAttribute("data-phrase") ?? "");
        if (words) fill(host, words);
    }
    for (const [name, key] of ATTRIBUTES) {
        for (const host of root.querySelectorAll(`[${key}]`)) {
            const words = translation(host.getAttribute(key) ?? "");
            if (words) host.setAttribute(name, words);
        }
    }
}

/**
 * Fill an element with a phrase, in which `**` is around bold words and a backtick around code.
 * @param {Element} host
 * @param {string} words
 */
function fill(host, words) {
    const parts = words.split(MARKED).filter(Boolean);
    if (parts.length < 2) setText(host, words);
    else host.replaceChildren(...element("p", parts.map((part) => nodeOf(part))).childNodes);
}

/** @param {string} part */
function nodeOf(part) {
    if (part.startsWith("**")) return element("strong", part.slice(2, -2));
    return part.startsWith("`") ? element("code", part.slice(1, -1)) : part;
}

/** @returns {string[]} Codes of the languages of this page; only English if the page names none. */
function offered() {
    const named = document.querySelector('meta[name="flinders-languages"]')?.getAttribute("content") ?? "";
    return [ENGLISH, ...named.split(" ").filter(Boolean)];
}

/** @returns {string} The language that was chosen here, else the first of the browser's that there is. */
function wantedCode() {
    const codes = offered();
    const wanted = [recall(KEY) ?? "", ...navigator.languages.map((name) => name.split("-")[0])];
    return wanted.find((code) => codes.includes(code)) ?? ENGLISH;
}

/** Load the wanted language; if its file cannot be loaded, the page stays English. */
async function load() {
    const code = wantedCode();
    if (code === ENGLISH) return;
    try {
        const answer = await fetch(new URL(`languages/${code}.json`, document.baseURI));
        if (!answer.ok) throw new Error(`${answer.status}`);
        useLanguage(code, await answer.json());
        document.documentElement.lang = code;
    } catch (error) {
        console.warn(`flinders: no words in ${code}:`, error);
    }
}

/**
 * Let the user choose the language; a choice reloads the page.
 * @param {HTMLSelectElement} list  whose options are the languages
 */
export function listenForLanguage(list) {
    list.value = language.code;
    list.addEventListener("change", () => {
        remember(KEY, list.value);
        window.location.reload();
    });
}

if (typeof document !== "undefined") await load(); // workers and tests have no document
