/** Evaluates recordings as the page without a server does: reads JSON on standard input, writes a result for each. */

import { readFileSync } from "node:fs";
import { pathToFileURL } from "node:url";

const { modules, wasm, data, schema, recordings, turns } = JSON.parse(readFileSync(0, "utf-8"));
const load = (name) => import(pathToFileURL(`${modules}/${name}`));
const [{ loadEngine }, { evaluate }, { readCalibration }] = await Promise.all(["engine.js", "evaluate.js", "targets.js"].map(load));
const engine = await loadEngine(readFileSync(wasm), data.layouts);

const floats = (text) => text && new Float64Array(Uint8Array.from(Buffer.from(text, "base64")).buffer);
const milliseconds = (work) => {
    const taken = Array.from({ length: turns }, () => {
        const begin = process.cpuUsage();
        work();
        const { user, system } = process.cpuUsage(begin);
        return (user + system) / 1000;
    });
    return taken.sort((one, other) => one - other)[turns >> 1] ?? 0;
};
const answers = recordings.map((asked) => {
    const { name, text } = asked.previous ?? {};
    const previous = asked.previous && { name, calibration: readCalibration(text, { targets: { schema } }) };
    const readings = { ...asked, field: floats(asked.field), time: floats(asked.time), acceleration: floats(asked.acceleration), previous };
    const { field, time, dipDeg } = readings;
    return {
        ...evaluate(engine, data, readings),
        engine: engine.fit(field, time, { dipDeg }),
        fit_ms: milliseconds(() => engine.fit(field, time, { dipDeg })),
        evaluate_ms: milliseconds(() => evaluate(engine, data, readings)),
    };
});
process.stdout.write(JSON.stringify({ answers }));
