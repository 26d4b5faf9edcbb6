/**
 * Shaders of the 3-D view for tiles, points, lines and the marker of the newest reading.
 *
 * Shaders smooth edges by the gradient of a quantity per pixel, so that the view needs no multisampling and looks the same
 * in software WebGL. All colours are sRGB.
 */

import { Color, ShaderMaterial, Vector2, Vector3 } from "../vendor/three.js";

/** @typedef {Record<string, {value: any}>} Uniforms */

/**
 * Visibility of a point behind the unit sphere, for a camera at a finite distance, in the axes of the sphere.
 */
const HIDDEN = /* glsl */ `
    float hidden(vec3 point, vec3 eye) {
        vec3 way = point - eye;
        float far = length(way);
        vec3 ray = way / far;
        float nearest = -dot(eye, ray);
        float off = length(eye + nearest * ray);
        float entry = nearest - sqrt(max(1.0 - off * off, 0.0));
        return (1.0 - smoothstep(0.985, 1.005, off)) * smoothstep(0.0, 0.02, far - entry);
    }`;

/**
 * A material with its own shaders; uniforms can be changed later by name.
 *
 * @param {{uniforms: Record<string, any>, vertexShader: string, fragmentShader: string, isFlat?: boolean}} said
 *     isFlat: drawn over everything, at any distance
 * @returns {ShaderMaterial}
 */
function shaderMaterial({ uniforms, isFlat = false, ...shaders }) {
    /** @type {Uniforms} */
    const named = Object.fromEntries(Object.entries(uniforms).map(([name, value]) => [name, { value }]));
    const how = { transparent: true, depthTest: !isFlat, depthWrite: !isFlat };
    return new ShaderMaterial({ ...how, uniforms: named, ...shaders });
}

/** @returns {ShaderMaterial} */
export function tileMaterial() {
    return shaderMaterial({
        uniforms: {
            share: 1,
            seam: new Color(),
            unknown: new Color(),
            ink: new Color(),
            next: -1,
            pulse: 0,
            depth: 0.28,
        },
        vertexShader: /* glsl */ `
            attribute vec2 local;
            attribute float edge;
            attribute float tile;
            attribute vec4 before;
            attribute vec4 after;
            uniform float share;
            uniform float next;
            varying vec4 tint;
            varying vec2 place;
            varying float rim;
            varying float chosen;
            varying vec3 normal_;
            varying vec3 toEye;
            void main() {
                vec4 seen = modelViewMatrix * vec4(position, 1.0);
                tint = mix(before, after, share);
                place = local;
                rim = edge;
                chosen = abs(tile - next) < 0.5 ? 1.0 : 0.0;
                normal_ = normalMatrix * position;
                toEye = -seen.xyz;
                gl_Position = projectionMatrix * seen;
            }`,
        fragmentShader: /* glsl */ `
            #define SEAM 0.0036
            uniform vec3 seam;
            uniform vec3 unknown;
            uniform vec3 ink;
            uniform float pulse;
            uniform float depth;
            varying vec4 tint;
            varying vec2 place;
            varying float rim;
            varying float chosen;
            varying vec3 normal_;
            varying vec3 toEye;

            // Stripes across a tile, and their mean where they are finer than pixels.
            float hatch(vec2 at) {
                float phase = (at.x + at.y) * 1.9;
                float fine = fwidth(phase);
                float stripe = abs(fract(phase) - 0.5) * 2.0;
                float line = smoothstep(0.62 - 2.0 * fine, 0.62 + 2.0 * fine, stripe);
                return mix(line, 0.38, smoothstep(0.25, 0.5, fine));
            }

            void main() {
                vec3 normal = normalize(normal_);
                float facing = dot(normal, normalize(toEye));
                // opacity of the tint: 1 with readings, ½ without readings, 0 if unknown
                float seen = smoothstep(0.5, 1.0, tint.a);
                float known = smoothstep(0.0, 0.5, tint.a);
                float striped = hatch(place);
                vec3 empty = mix(unknown, mix(unknown, tint.rgb, mix(0.3, 0.85, striped)), known);
                empty = mix(mix(empty, seam, 0.3 * striped), empty, known);
                vec3 colour = mix(empty, tint.rgb, seen);

                float light = 0.5 + 0.5 * dot(normal, normalize(vec3(-0.35, 0.6, 0.72)));
                colour *= 1.0 + depth * (light * light - 0.86);
                colour *= mix(1.0 - 0.7 * depth, 1.0, smoothstep(0.0, 0.5, facing));
                colour *= mix(0.93, 1.0, smoothstep(0.004, 0.03, rim));
                colour = mix(colour, ink, chosen * (0.12 + 0.5 * pulse) * (1.0 - 0.75 * smoothstep(0.0, 0.05, rim)));

                // a seam has a constant width; below one pixel, it is fainter instead
                float soft = fwidth(rim);
                float reach = max(SEAM, 0.5 * soft);
                float seamed = (1.0 - smoothstep(reach - 0.6 * soft, reach + 0.6 * soft, rim)) * SEAM / reach;
                colour = mix(colour, mix(seam, ink, 0.85 * chosen), seamed);
                gl_FragColor = vec4(colour, smoothstep(0.0, 1.5 * fwidth(facing), facing));
            }`,
    });
}

/** @returns {ShaderMaterial} */
export function pointMaterial() {
    return shaderMaterial({
        uniforms: {
            onto: 0,
            size: 1,
            colour: new Color(),
            rejected: new Color(),
            excluded: new Color(),
            opacity: 1,
            haze: new Vector2(1, 2),
            least: 2,
            every: 1,
        },
        vertexShader: /* glsl */ `
            attribute float mark;
            uniform int every;
            uniform float onto;
            uniform float size;
            uniform float least;
            uniform vec2 haze;
            uniform vec3 colour;
            uniform vec3 rejected;
            uniform vec3 excluded;
            uniform float opacity;
            varying vec4 tint;
            varying float side;
            varying float crossed;
            void main() {
                vec3 at = (modelMatrix * vec4(position, 1.0)).xyz;
                at = mix(at, normalize(at) * 1.004, onto);
                bool isBehind = onto > 0.99 && dot(at, cameraPosition) < 1.0; // on the far side of the sphere
                if (isBehind || gl_VertexID % every != 0) {
                    gl_Position = vec4(2.0, 2.0, 2.0, 1.0); // not drawn at all
                    return;
                }
                vec4 seen = viewMatrix * vec4(at, 1.0);
                float far = smoothstep(haze.x, haze.y, -seen.z);
                float left = step(0.5, mark);
                crossed = step(0.5, mark) * step(mark, 1.5);
                tint = vec4(mix(colour, mix(excluded, rejected, crossed), left), mix(opacity, 1.0, crossed));
                tint.a *= mix(1.0, 0.3, far) * mix(1.0, 0.55, left - crossed);
                side = max(size / -seen.z, least) * (1.0 + 1.9 * crossed) + 1.0;
                gl_PointSize = side;
                gl_Position = projectionMatrix * seen;
            }`,
        fragmentShader: /* glsl */ `
            varying vec4 tint;
            varying float side;
            varying float crossed;
            void main() {
                vec2 at = (gl_PointCoord - 0.5) * side;
                float disc = clamp(0.5 * side - length(at), 0.0, 1.0);
                vec2 turned = abs(vec2(at.x + at.y, at.x - at.y)) * 0.7071;
                float arm = clamp(1.3 - min(turned.x, turned.y), 0.0, 1.0)
                    * clamp(0.5 * side - max(turned.x, turned.y), 0.0, 1.0);
                float alpha = tint.a * mix(disc, arm, crossed);
                if (alpha < 0.04) discard;
                gl_FragColor = vec4(tint.rgb, alpha);
            }`,
    });
}

/**
 * Lines of a width in pixels, with a border in another colour where `border` is given.
 *
 * @param {{width: number, opacity?: number, behind?: number, border?: number}} options
 *     behind: relative opacity behind the sphere
 * @returns {ShaderMaterial}
 */
export function lineMaterial({ width, opacity = 1, behind = 0, border = 0 }) {
    return shaderMaterial({
        isFlat: true,
        uniforms: {
            thick: width,
            opacity: opacity,
            behind: behind,
            border: border,
            colour: new Color(),
            halo: new Color(),
            viewport: new Vector2(1, 1),
            scale: 1,
            eye: new Vector3(),
        },
        vertexShader: /* glsl */ `
            attribute vec3 start;
            attribute vec3 end;
            attribute vec2 alpha;
            attribute vec2 width;
            uniform vec2 viewport;
            uniform float thick;
            uniform float border;
            uniform float scale;
            uniform float opacity;
            uniform vec3 eye;
            uniform float behind;
            varying float across;
            varying float reach;
            varying float strength;
            ${HIDDEN}
            void main() {
                vec4 a = projectionMatrix * modelViewMatrix * vec4(start, 1.0);
                vec4 b = projectionMatrix * modelViewMatrix * vec4(end, 1.0);
                vec2 along = (b.xy / b.w - a.xy / a.w) * viewport;
                along = dot(along, along) > 1e-8 ? normalize(along) : vec2(1.0, 0.0);
                float last = position.x;
                reach = 0.5 * thick * scale * mix(width.x, width.y, last) + border * scale;
                across = position.y * (reach + 1.0);
                vec4 at = mix(a, b, last);
                at.xy += vec2(-along.y, along.x) * across / viewport * 2.0 * at.w;
                vec3 place = mix(start, end, last);
                strength = opacity * mix(alpha.x, alpha.y, last) * mix(1.0, behind, hidden(place, eye));
                gl_Position = at;
            }`,
        fragmentShader: /* glsl */ `
            uniform vec3 colour;
            uniform vec3 halo;
            uniform float border;
            uniform float scale;
            varying float across;
            varying float reach;
            varying float strength;
            void main() {
                float off = abs(across);
                float whole = clamp(reach + 0.5 - off, 0.0, 1.0);
                float inner = clamp(reach - border * scale + 0.5 - off, 0.0, 1.0);
                gl_FragColor = vec4(mix(halo, colour, inner), strength * whole * mix(0.7, 1.0, inner));
            }`,
    });
}

/** A dot in a ring, of constant size on the screen; of two, each ring has the colour of its cloud. @returns {ShaderMaterial} */
export function markerMaterial() {
    return shaderMaterial({
        isFlat: true,
        uniforms: {
            side: 20,
            ink: new Color(),
            halo: new Color(),
            first: new Color(),
            second: new Color(),
            both: 0,
            eye: new Vector3(),
            solid: 1,
        },
        vertexShader: /* glsl */ `
            uniform float side;
            uniform vec3 eye;
            uniform float solid;
            uniform float both;
            uniform vec3 ink;
            uniform vec3 first;
            uniform vec3 second;
            attribute float which;
            varying float strength;
            varying vec3 around;
            ${HIDDEN}
            void main() {
                around = mix(ink, mix(first, second, which), both);
                strength = mix(1.0, 0.35, solid * hidden(position, eye));
                gl_PointSize = side + 2.0;
                gl_Position = projectionMatrix * modelViewMatrix * vec4(position, 1.0);
            }`,
        fragmentShader: /* glsl */ `
            uniform float side;
            uniform vec3 ink;
            uniform vec3 halo;
            varying float strength;
            varying vec3 around;
            void main() {
                float off = length(gl_PointCoord - 0.5) * (side + 2.0) / side * 2.0;
                float soft = 2.0 / side;
                float dot_ = 1.0 - smoothstep(0.42 - soft, 0.42 + soft, off);
                float ring = smoothstep(0.66 - soft, 0.66 + soft, off) * (1.0 - smoothstep(0.84 - soft, 0.84 + soft, off));
                float whole = 1.0 - smoothstep(1.0 - soft, 1.0, off);
                float lit = max(dot_, ring);
                gl_FragColor = vec4(mix(halo, mix(ink, around, ring), lit), strength * whole * mix(0.62, 1.0, lit));
            }`,
    });
}
