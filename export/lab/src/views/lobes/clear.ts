/** What the outer shells of a lobe are made of: they let the inner ones be seen. */

import * as THREE from "three";

/** Clear where it is seen from the front, coloured towards its rim. It shines of itself: its colour is that of the legend,
 * and a pixel of it costs little where there is no graphics processor. */
export class Clear extends THREE.ShaderMaterial {
  readonly colour = new THREE.Color();

  constructor() {
    super({
      transparent: true,
      depthWrite: false,
      vertexShader: `varying vec3 n, v;
void main() {
  vec4 seen = modelViewMatrix * vec4(position, 1.0);
  n = normalMatrix * normal;
  v = seen.xyz;
  gl_Position = projectionMatrix * seen;
}`,
      fragmentShader: `varying vec3 n, v;
uniform vec3 colour;
void main() {
  float rim = 1.0 - abs(dot(normalize(v), normalize(n)));
  gl_FragColor = vec4(colour, mix(0.2, 0.95, pow(rim, 1.7)));
  #include <colorspace_fragment>
}`,
    });
    this.uniforms["colour"] = { value: this.colour };
  }
}
