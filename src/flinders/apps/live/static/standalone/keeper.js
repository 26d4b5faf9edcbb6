/**
 * Readings of a board in the browser's database, and what was done to them, so that loading the page again, or a crash,
 * loses none.
 *
 * One page of an address has them at a time; another one that is open beside it keeps nothing.
 */

/** @typedef {import("./buffer.js").ReadingBuffer} ReadingBuffer */
/** @typedef {import("../messages.d.ts").SourceState["kind"]} Kind */
/** @typedef {{name: string, kind: Kind, unit: import("./session.js").Unit}} Of */
/** @typedef {Of & {time: Float64Array, field: Float64Array, acceleration: Float64Array | null}} Kept */

const NAME = "flinders-readings";
/** Key of what was done to the readings; those have numbers. */
const EDITS = "edits";
const WRITE_MS = 1000;
/** A page that is loaded again waits so long for its predecessor to go; then it begins without what that kept. */
const RELEASE_MS = 2000;

export class Keeper {
    /** @param {IDBDatabase | null} database  Null where the browser has none for us. */
    constructor(database) {
        this.database = database;
        /** @type {Kept[]} */
        this.waiting = [];
        this.timer = 0;
        /** Called where the browser has no more room. */
        this.onFull = () => {};
        /** Called where it is ours later, as the page that had it is closed. */
        this.onOpen = () => {};
    }

    /** @returns {Promise<Keeper>} */
    static async open() {
        const keeper = new Keeper(null); // as long as another page has it, or storage is switched off
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
     * Keep the readings of a buffer from a number on; within a second they are in the database.
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

    /** Write what waits. */
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
    }

    /** Keep what was done to the readings. @param {import("../wire.d.ts").Edits} edits */
    note(edits) {
        this.database?.transaction(NAME, "readwrite").objectStore(NAME).put(edits, EDITS);
    }

    /** @returns {Promise<import("../wire.d.ts").Edits | null>} What was done to the readings; null where nothing was. */
    async edits() {
        return this.database && ((await answer(this.database.transaction(NAME).objectStore(NAME).get(EDITS))) ?? null);
    }

    /** Forget all of them. */
    clear() {
        this.waiting = [];
        this.database?.transaction(NAME, "readwrite").objectStore(NAME).clear();
    }

    /** @returns {Promise<Kept | null>} All that are here; null where there are none. */
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
 * Lock a name until the page is closed, once no other page has it. When a page is loaded again, the lock of the one before
 * is released a moment later.
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
