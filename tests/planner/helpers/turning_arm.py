"""A six-joint arm as a product of turns about axes; nothing of planner.robotcell is used."""

import numpy as np
from scipy.spatial.transform import Rotation

AXES = np.array([[0, 0, 1], [0, 1, 0], [0, 1, 0], [0, 1, 0], [0, 0, -1], [0, 1, 0]], dtype=float)
PLACES = np.array(
    [[0, 0, 180], [0, 140, 180], [0, 120, 790], [0, 120, 1360], [0, 120, 1360], [0, 240, 1480]],
    dtype=float,
)
TIP = np.array([0.0, 240.0, 1560.0])


class TurningArm:
    """Forward kinematics by exponentials; the Jacobian by central differences."""

    def forward(self, joints):
        joints = np.asarray(joints, dtype=float)
        poses = np.broadcast_to(np.eye(4), (len(joints), 4, 4)).copy()
        for k in range(6):
            step = np.broadcast_to(np.eye(4), poses.shape).copy()
            step[:, :3, :3] = Rotation.from_rotvec(joints[:, k, None] * AXES[k]).as_matrix()
            step[:, :3, 3] = PLACES[k] - step[:, :3, :3] @ PLACES[k]
            poses = poses @ step
        tip = np.eye(4)
        tip[:3, 3] = TIP
        return poses @ tip

    def jacobian(self, joints, step=1e-6):
        columns = []
        for k in range(6):
            turn = np.zeros(6)
            turn[k] = step
            after = self.forward(joints + turn)
            before = self.forward(joints - turn)
            shift = (after - before)[:, :3, 3]
            turned = Rotation.from_matrix(
                after[:, :3, :3] @ before[:, :3, :3].transpose(0, 2, 1)
            ).as_rotvec()
            columns.append(np.concatenate([shift, turned], axis=1) / (2 * step))
        return np.stack(columns, axis=2)
