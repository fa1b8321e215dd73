// SPDX-License-Identifier: GPL-3.0-or-later
// Writes one solid as STEP AP214: entities are added one by one, then the file around them. Millimetres, radians.
#pragma once

#include <map>
#include <string>
#include <utility>
#include <vector>

#include "planner/base/frames.hpp"

namespace asbuilt::simulate_detail {

class StepWriter {
 public:
  int add(const std::string& text);
  int point(const Vec3& p);
  int direction(const Vec3& d);
  int placement(const Vec3& o, const Vec3& z, const Vec3& x);
  int vertex(const Vec3& p);
  int line_edge(const Vec3& a, const Vec3& b);
  /// Counter-clockwise about `up` from a to b (a full circle when they are the same point).
  int circle_edge(const Vec3& center, const Vec3& up, double radius_mm, const Vec3& a, const Vec3& b);
  /// Clamped cubic, uniform knots; from the first pole to the last.
  int spline_edge(const std::vector<Vec3>& poles);
  int loop(const std::vector<std::pair<int, bool>>& edges);
  void face(int surface, bool same_sense, const std::vector<int>& loops);
  int plane(const Vec3& o, const Vec3& n);
  int cylinder(const Vec3& o, const Vec3& axis, double radius_mm);
  /// radius(o) given; it grows along the axis by tan(half angle > 0).
  int cone(const Vec3& o, const Vec3& axis, double radius_mm, double half_angle_rad);
  int torus(const Vec3& o, const Vec3& axis, double major_mm, double minor_mm);
  /// Clamped bicubic, uniform knots: poles[i][j], u along i, v along j.
  int spline_surface(const std::vector<std::vector<Vec3>>& poles);
  std::string finish(const std::string& name);

 private:
  int last_ = 0;
  std::string body_;
  std::vector<int> faces_;
  std::map<std::string, int> vertices_;
};

}  // namespace asbuilt::simulate_detail
