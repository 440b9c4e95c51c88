// Where the ground of a mesh is in the space of the mesh.

/** Three rows of four numbers, times a point, or with w = 0 a direction. */
const times = (rows, [x, y, z], w = 1) => [0, 4, 8].map((k) => rows[k] * x + rows[k + 1] * y + rows[k + 2] * z + rows[k + 3] * w);

export class GroundFrame {
  /** Takes what src/ground.rs packs. */
  constructor(numbers) {
    [this.scale, this.meshFromGround, this.groundFromMesh] = [numbers[0], numbers.subarray(1, 13), numbers.subarray(13)];
  }

  point(point) {
    return times(this.meshFromGround, point);
  }

  pointOfGround(point) {
    return times(this.groundFromMesh, point);
  }

  offsetOfGround(offset) {
    return times(this.groundFromMesh, offset, 0);
  }

  view({ position = [0, 0, 0], forward = [0, 0, -1], up = [0, 1, 0], near = 1e-3, ...rest }) {
    return { ...rest, position: this.pointOfGround(position), forward: this.offsetOfGround(forward), up: this.offsetOfGround(up), near: near / this.scale };
  }
}
