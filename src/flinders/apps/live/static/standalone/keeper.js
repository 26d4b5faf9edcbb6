/**
 * Stores readings of a board and the user's edits in the browser's database, so that they survive a reload or a crash.
 *
 * Only one open page of an address uses the database; further pages store nothing.
 */

/** @typedef {import("./buffer.js").ReadingBuffer} ReadingBuffer */
/** @typedef {import("../messages.d.ts").SourceState["kind"]} Kind */
/** @typedef {{name: string, kind: Kind, unit: import("./session.js").Unit}} Of */
/** @typedef {Of & {time: Float64Array, field: Float64Array, acceleration: Float64Array | null}} Kept */

const NAME = "flinders-readings";
/** Key of the edits; readings have numbers as keys. */
const EDITS = "edits";
const WRITE_MS = 1000;
/** Longest wait of a reloaded page for the previous page's lock; after that it starts without stored readings. */
const RELEASE_MS = 2000;

export class Keeper {
    /** @param {IDBDatabase | null} database  Null if the browser has no database. */
    constructor(database) {
        this.database = database;
        /** @type {Kept[]} */
        this.waiting = [];
        this.timer = 0;
        /** Called if the storage is full. */
        this.onFull = () => {};
        /** Called when the database becomes available, after another page was closed. */
        this.onOpen = () => {};
    }

    /** @returns {Promise<Keeper>} */
    static async open() {
        const keeper = new Keeper(null); // while another page has the database, or storage is off
        const open = async () => {
            await acquireLock(NAME);
            keeper.database = await openDatabase(NAME);
            keeper.onOpen();
        };
        await Promise.race([open().catch(() => {}), new Promise((done) => setTimeout(done, RELEASE_MS))]);
        return keeper;
    }

    get isOpen() {
        return this.database !== null;
    }

    /**
     * Store the readings of a buffer from number `before` on; they are written within a second.
     * @param {Of} of  the source
     * @param {ReadingBuffer} buffer
     * @param {number} before
     */
    add(of, buffer, before) {
        if (!this.database) return;
        const from = Math.ceil(before / buffer.stride);
        const acceleration = buffer.acceleration?.slice(3 * from) ?? null;
        this.waiting.push({ ...of, time: buffer.time.slice(from), field: buffer.field.slice(3 * from), acceleration });
        this.timer ||= window.setTimeout(() => this.write(), WRITE_MS);
    }

    /** Write queued readings. */
    write() {
        window.clearTimeout(this.timer);
        this.timer = 0;
        const { waiting } = this;
        this.waiting = [];
        if (!this.database || waiting.length === 0) return;
        const transaction = this.database.transaction(NAME, "readwrite");
        transaction.objectStore(NAME).add(mergeParts(waiting));
        transaction.addEventListener("abort", () => {
            this.database = null;
            this.onFull();
        });
        transaction.commit(); // at once: a transaction that is open when the page unloads is lost
    }

    /** Store edits. @param {import("../wire.d.ts").Edits} edits */
    note(edits) {
        this.database?.transaction(NAME, "readwrite").objectStore(NAME).put(edits, EDITS);
    }

    /** @returns {Promise<import("../wire.d.ts").Edits | null>} The stored edits; null without any. */
    async edits() {
        return this.database && ((await answer(this.database.transaction(NAME).objectStore(NAME).get(EDITS))) ?? null);
    }

    /** Delete all readings and edits. */
    clear() {
        this.waiting = [];
        this.database?.transaction(NAME, "readwrite").objectStore(NAME).clear();
    }

    /** @returns {Promise<Kept | null>} All stored readings; null without any. */
    async readings() {
        if (!this.database) return null;
        const numbered = IDBKeyRange.bound(0, Infinity);
        const parts = /** @type {Kept[]} */ (await answer(this.database.transaction(NAME).objectStore(NAME).getAll(numbered)));
        return parts.length > 0 ? mergeParts(parts) : null;
    }
}

/** @param {Kept[]} parts @returns {Kept} */
function mergeParts(parts) {
    const [time, field] = [joinArrays(parts.map((part) => part.time)), joinArrays(parts.map((part) => part.field))];
    const felt = () => joinArrays(parts.map((part) => part.acceleration ?? new Float64Array(part.field.length).fill(NaN)));
    return { ...parts[0], time, field, acceleration: parts.some((part) => part.acceleration) ? felt() : null };
}

/**
 * @param {Float64Array[]} parts
 * @returns {Float64Array}
 */
function joinArrays(parts) {
    const all = new Float64Array(parts.reduce((sum, { length }) => sum + length, 0));
    let at = 0;
    for (const part of parts) {
        all.set(part, at);
        at += part.length;
    }
    return all;
}

/**
 * Acquire the lock of a name until the page is closed. After a reload, the previous page releases its lock with a delay.
 * @param {string} name
 * @returns {Promise<void>}
 */
function acquireLock(name) {
    return new Promise((done, failed) => {
        const whileOpen = () => {
            done();
            return new Promise(() => {});
        };
        navigator.locks.request(name, whileOpen).catch(failed);
    });
}

/**
 * @param {string} name
 * @returns {Promise<IDBDatabase>}
 */
function openDatabase(name) {
    const request = indexedDB.open(name, 1);
    request.addEventListener("upgradeneeded", () => request.result.createObjectStore(name, { autoIncrement: true }));
    return answer(request);
}

/**
 * @template T
 * @param {IDBRequest<T>} request
 * @returns {Promise<T>}
 */
function answer(request) {
    return new Promise((done, failed) => {
        request.addEventListener("success", () => done(request.result));
        request.addEventListener("error", () => failed(request.error));
    });
}
