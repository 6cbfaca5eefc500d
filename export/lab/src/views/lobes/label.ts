/** A letter that always faces the viewer. */

import * as THREE from "three";

export function label(text: string, at: readonly [number, number, number], colour: string): THREE.Sprite {
  const canvas = document.createElement("canvas");
  canvas.width = canvas.height = 64;
  const context = canvas.getContext("2d");
  if (context) {
    context.fillStyle = colour;
    context.font = "italic 44px Georgia, serif";
    context.textAlign = "center";
    context.textBaseline = "middle";
    context.fillText(text, 32, 34);
  }
  const map = new THREE.CanvasTexture(canvas);
  // Else its colours are taken for linear ones, and come out pale.
  map.colorSpace = THREE.SRGBColorSpace;
  const material = new THREE.SpriteMaterial({ map, transparent: true, depthTest: false });
  const sprite = new THREE.Sprite(material);
  sprite.position.set(...at);
  sprite.scale.setScalar(0.16);
  return sprite;
}
