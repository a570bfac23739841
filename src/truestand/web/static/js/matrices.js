// 4 x 4 matrices, column after column, as WebGL wants them.

export function multiplied(a, b) {
  const out = new Float32Array(16);
  for (let column = 0; column < 4; column++)
    for (let row = 0; row < 4; row++)
      for (let k = 0; k < 4; k++) out[4 * column + row] += a[4 * k + row] * b[4 * column + k];
  return out;
}

export function perspective(angle, aspect, near, far) {
  const f = 1 / Math.tan(angle / 2);
  return new Float32Array([f / aspect, 0, 0, 0, 0, f, 0, 0, 0, 0, (far + near) / (near - far), -1, 0, 0, (2 * far * near) / (near - far), 0]);
}

/** From the part, z up, to an eye that has gone round it by `turn` and up by `lift`. */
export function orbit(turn, lift, distance, [right, up]) {
  const [c, s, cl, sl] = [Math.cos(turn), Math.sin(turn), Math.cos(lift), Math.sin(lift)];
  return new Float32Array([-s, -sl * c, cl * c, 0, c, -sl * s, cl * s, 0, 0, cl, sl, 0, right, up, -distance, 1]);
}
