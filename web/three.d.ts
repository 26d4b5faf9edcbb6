// What the bundle exports, for those who check the types of the views; it lies beside the bundle.
export * from "three";
export { OrbitControls } from "three/addons/controls/OrbitControls.js";
