// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/calibrate/image_targets.hpp"

#include <fmt/format.h>

#include <opencv2/aruco/charuco.hpp>
#include <opencv2/calib3d.hpp>
#include <opencv2/features2d.hpp>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

namespace asbuilt {

namespace {

cv::Mat camera_matrix(const CameraConstants& c) { return (cv::Mat_<double>(3, 3) << c[0], 0, c[2], 0, c[1], c[3], 0, 0, 1); }
cv::Mat distortion(const CameraConstants& c) { return (cv::Mat_<double>(1, 5) << c[4], c[5], c[6], c[7], c[8]); }

void split(const std::vector<Vec3>& board, const std::vector<ImagePoint>& points, std::vector<cv::Point3d>& object, std::vector<cv::Point2d>& image) {
  for (const ImagePoint& p : points) {
    const Vec3& b = board.at(static_cast<std::size_t>(p.id));
    object.emplace_back(b.x(), b.y(), b.z());
    image.emplace_back(p.at_px.x(), p.at_px.y());
  }
}

}  // namespace

std::vector<Vec3> board_points(const TargetSpec& t) {
  std::vector<Vec3> points;
  for (int r = 0; r < t.rows_count; ++r)
    for (int c = 0; c < t.columns_count; ++c) points.emplace_back(c * t.pitch_mm, r * t.pitch_mm, 0);
  return points;
}

Result<std::vector<ImagePoint>> find_board(const TargetSpec& t, const std::string& bytes, const std::string& name) {
  const std::vector<unsigned char> data(bytes.begin(), bytes.end());
  cv::Mat grey;
  try {
    grey = cv::imdecode(data, cv::IMREAD_GRAYSCALE);
  } catch (const cv::Exception&) {
    grey.release();
  }
  if (grey.empty())
    return refuse({.code = "input.image_unreadable", .where = name, .message = "found no image that can be decoded, allowed PNG, JPEG, TIFF or BMP", .stage = "input"});
  std::vector<ImagePoint> out;
  const cv::Size size(t.columns_count, t.rows_count);
  try {
    std::vector<cv::Point2f> found;
    if (t.kind == TargetKind::checkerboard) {
      if (!cv::findChessboardCornersSB(grey, size, found, cv::CALIB_CB_EXHAUSTIVE | cv::CALIB_CB_ACCURACY | cv::CALIB_CB_NORMALIZE_IMAGE)) return out;
    } else if (t.kind == TargetKind::circle_grid) {
      cv::SimpleBlobDetector::Params p;
      p.minArea = 12, p.maxArea = static_cast<float>(grey.total()) / 40, p.filterByConvexity = true, p.minConvexity = 0.8f, p.filterByInertia = true, p.minInertiaRatio = 0.1f;
      bool is_found = false;
      for (int blob : {0, 255}) {  // dark circles, then bright ones
        p.filterByColor = true, p.blobColor = static_cast<unsigned char>(blob);
        if (cv::findCirclesGrid(grey, size, found, cv::CALIB_CB_SYMMETRIC_GRID | cv::CALIB_CB_CLUSTERING, cv::SimpleBlobDetector::create(p)) ||
            cv::findCirclesGrid(grey, size, found, cv::CALIB_CB_SYMMETRIC_GRID, cv::SimpleBlobDetector::create(p))) {
          is_found = true;
          break;
        }
      }
      if (!is_found) return out;
    } else {
      // columns and rows count inner corners: one square more each way
      const auto dictionary = cv::aruco::getPredefinedDictionary(t.dictionary);
      const auto board = cv::aruco::CharucoBoard::create(t.columns_count + 1, t.rows_count + 1, static_cast<float>(t.pitch_mm), static_cast<float>(t.marker_mm), dictionary);
      std::vector<std::vector<cv::Point2f>> markers;
      std::vector<int> marker_ids, ids;
      cv::aruco::detectMarkers(grey, dictionary, markers, marker_ids);
      if (marker_ids.empty()) return out;
      cv::aruco::interpolateCornersCharuco(markers, marker_ids, grey, board, found, ids);
      if (found.size() < 6) return out;
      for (std::size_t i = 0; i < found.size(); ++i) out.push_back({ids[i], Vec2(found[i].x, found[i].y)});
      return out;
    }
    for (std::size_t i = 0; i < found.size(); ++i) out.push_back({static_cast<int>(i), Vec2(found[i].x, found[i].y)});
  } catch (const cv::Exception&) {
    out.clear();  // what OpenCV cannot digest is a board that was not seen
  }
  return out;
}

std::optional<BoardPose> board_pose(const std::vector<Vec3>& board, const std::vector<ImagePoint>& points, const CameraConstants& camera) {
  if (points.size() < 4) return std::nullopt;
  std::vector<cv::Point3d> object;
  std::vector<cv::Point2d> image;
  split(board, points, object, image);
  try {
    cv::Mat r, t;
    if (!cv::solvePnP(object, image, camera_matrix(camera), distortion(camera), r, t, false, cv::SOLVEPNP_IPPE)) return std::nullopt;
    cv::solvePnPRefineLM(object, image, camera_matrix(camera), distortion(camera), r, t);
    BoardPose out;
    out.T_sensor_target = {quat_exp(Vec3(r.at<double>(0), r.at<double>(1), r.at<double>(2))), Vec3(t.at<double>(0), t.at<double>(1), t.at<double>(2))};
    std::vector<cv::Point2d> again;
    cv::projectPoints(object, r, t, camera_matrix(camera), distortion(camera), again);
    for (std::size_t i = 0; i < image.size(); ++i) out.rms_px += std::pow(again[i].x - image[i].x, 2) + std::pow(again[i].y - image[i].y, 2);
    out.rms_px = std::sqrt(out.rms_px / static_cast<double>(image.size()));
    return out;
  } catch (const cv::Exception&) {
    return std::nullopt;
  }
}

std::optional<CameraConstants> camera_guess(const std::vector<Vec3>& board, const std::vector<std::vector<ImagePoint>>& views) {
  std::vector<std::vector<cv::Point3f>> object;
  std::vector<std::vector<cv::Point2f>> image;
  double u = 0, v = 0;
  for (const auto& points : views) {
    if (points.size() < 6) continue;
    object.emplace_back(), image.emplace_back();
    for (const ImagePoint& p : points) {
      const Vec3& b = board.at(static_cast<std::size_t>(p.id));
      object.back().emplace_back(static_cast<float>(b.x()), static_cast<float>(b.y()), 0.f);
      image.back().emplace_back(static_cast<float>(p.at_px.x()), static_cast<float>(p.at_px.y()));
      u = std::max(u, p.at_px.x()), v = std::max(v, p.at_px.y());
    }
  }
  if (object.size() < 3) return std::nullopt;
  try {
    cv::Mat K, D;
    std::vector<cv::Mat> r, t;
    const cv::Size size(static_cast<int>(u * 1.1), static_cast<int>(v * 1.1));
    cv::calibrateCamera(object, image, size, K, D, r, t, cv::CALIB_FIX_K3);
    CameraConstants c{K.at<double>(0, 0), K.at<double>(1, 1), K.at<double>(0, 2), K.at<double>(1, 2), D.at<double>(0), D.at<double>(1), D.at<double>(2), D.at<double>(3), 0};
    return c;
  } catch (const cv::Exception&) {
    return std::nullopt;
  }
}

}  // namespace asbuilt
