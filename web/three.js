/* What `src/flinders/static/views` draws with: the part of three.js that the bundle keeps. */
export {
    BufferAttribute,
    BufferGeometry,
    Color,
    DynamicDrawUsage,
    Matrix4,
    Mesh,
    PerspectiveCamera,
    Points,
    Scene,
    ShaderMaterial,
    Vector2,
    Vector3,
    WebGLRenderer,
} from "three";
export { OrbitControls } from "three/addons/controls/OrbitControls.js";
