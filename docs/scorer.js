/** Order of the results of the search: pages for people before the API, decisions and tables of keys. */

var Scorer = {
    score: ([docname, title, anchor, , score, , kind]) => {
        const isApi = /(^|\/)api(\/|$)/.test(docname);
        const isRecord = /^(decisions|design|keys|errors)$|measured$|costs$/.test(docname);
        if (kind === "object") return score - 200;
        return score - (isApi ? 100 : 0) - (isRecord ? 25 : 0) + (anchor === null && kind === "title" ? 10 : 0);
    },
    objNameMatch: 11,
    objPartialMatch: 6,
    objPrio: { 0: 15, 1: 5, 2: -5 },
    objPrioDefault: 0,
    title: 15,
    partialTitle: 7,
    term: 5,
    partialTerm: 2,
};
