// SPDX-License-Identifier: GPL-3.0-or-later
// Boards in camera images: their points by OpenCV, and the pose of a board from its points.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "planner/artefacts/captures.hpp"
#include "planner/base/result.hpp"

namespace asbuilt {

/// Points of the board in its own frame, by id (row * columns + column): z = 0, x along the columns.
std::vector<Vec3> board_points(const TargetSpec& target);

/// The board's points in an image file's bytes (any format OpenCV decodes), sub-pixel. Empty where the board is not seen whole
/// (of a charuco board: where fewer than six points are seen). Refuses input.image_unreadable.
Result<std::vector<ImagePoint>> find_board(const TargetSpec& target, const std::string& image_bytes, const std::string& name);

struct BoardPose {
  Pose<frame::Sensor, frame::Target> T_sensor_target;
  double rms_px = 0;
};
/// Pose of the board in the camera (IPPE, then refined). None with fewer than four points.
std::optional<BoardPose> board_pose(const std::vector<Vec3>& board, const std::vector<ImagePoint>& points, const CameraConstants& camera);

/// First guess of a camera's constants from several views of a board (Zhang); needs three views. The principal point is taken
/// near the middle of what was seen.
std::optional<CameraConstants> camera_guess(const std::vector<Vec3>& board, const std::vector<std::vector<ImagePoint>>& views);

}  // namespace asbuilt
