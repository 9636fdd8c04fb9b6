export {
  BufferAttribute, BufferGeometry, Color, DirectionalLight, DoubleSide, Group, HemisphereLight, Mesh,
  MeshLambertMaterial, PerspectiveCamera, Points, PointsMaterial, REVISION, Scene, ShaderMaterial, Vector3,
  WebGLRenderer
} from "three";
export { TrackballControls } from "three/addons/controls/TrackballControls.js";
export { LineMaterial } from "three/addons/lines/LineMaterial.js";
export { LineSegments2 } from "three/addons/lines/LineSegments2.js";
export { LineSegmentsGeometry } from "three/addons/lines/LineSegmentsGeometry.js";
