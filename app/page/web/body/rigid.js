/** Turns and shifts as 3 x 4 matrices, row by row. */

/** A 3 x 4 matrix from a quaternion of about unit length (x, y, z, w) and a translation. */
export function rigid(rotation, [tx, ty, tz]) {
  // Turns of neighbouring frames are near one another, so a normalised mean stands for slerp.
  const length = Math.hypot(...rotation);
  const [x, y, z, w] = rotation.map((part) => part / length);
  return [
    1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w), tx,
    2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w), ty,
    2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y), tz,
  ];
}

/** Of two 3 x 4 matrices whose fourth row is (0, 0, 0, 1). */
export function product(a, b) {
  const result = new Array(12);
  for (let row = 0; row < 12; row += 4) {
    for (let column = 0; column < 4; column++) {
      result[row + column] =
        a[row] * b[column] + a[row + 1] * b[4 + column] + a[row + 2] * b[8 + column];
    }
    result[row + 3] += a[row + 3];
  }
  return result;
}
