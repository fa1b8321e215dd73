// SPDX-License-Identifier: GPL-3.0-or-later
// Typed access to instances by keyword, and points, axes, curves and surfaces from them, scaled to mm and rad.
// A fault is thrown as StepFault and caught where a face, an edge or a body is built; it never leaves the reader.
#pragma once

#include <string>
#include <vector>

#include "planner/geom/surface.hpp"
#include "planner/io/step/p21.hpp"

namespace asbuilt::step {

struct StepFault {
  std::uint32_t line = 0;
  std::int64_t id = 0;
  std::string entity, what;
  std::string text() const;  // "line: #id KEYWORD: what"
};

/// Units of one representation context.
struct Units {
  double length_mm = 1, angle_rad = 1, uncertainty_mm = 0;
  std::string name = "mm";
};

/// The parameters of one record.
class Args {
 public:
  Args() = default;
  Args(const p21::Value* first, std::uint32_t count) : first_(first), count_(count) {}
  std::uint32_t size() const { return count_; }
  const p21::Value* at(std::uint32_t i) const {  // null past the end
    if (i >= count_) return nullptr;
    const p21::Value* v = first_;
    while (i--) v = p21::next(v);
    return v;
  }
  const p21::Value* first() const { return first_; }

 private:
  const p21::Value* first_ = nullptr;
  std::uint32_t count_ = 0;
};

class Binder {
 public:
  explicit Binder(const p21::File& file) : file_(file) {}
  const p21::File& file() const { return file_; }
  Units units;

  // Records.
  const p21::Instance& instance(std::int64_t id) const;  // StepFault when there is none
  std::uint32_t key(const p21::Instance& i) const { return file_.records[i.record].keyword; }
  bool has(const p21::Instance& i, std::uint32_t keyword) const;   // any part
  Args args(const p21::Instance& i, std::uint32_t keyword) const;  // of that part; empty when it has none
  Args args(const p21::Instance& i) const;                         // of the first part
  [[noreturn]] void fail(const p21::Instance& i, std::string what) const;

  // Values; StepFault when the value is not of the kind.
  double real(const p21::Instance& i, const p21::Value* v) const;
  std::int64_t integer(const p21::Instance& i, const p21::Value* v) const;
  std::int64_t reference(const p21::Instance& i, const p21::Value* v) const;
  bool is_true(const p21::Instance& i, const p21::Value* v) const;
  std::string_view enumeration(const p21::Value* v) const;  // "" when it is none
  std::string text(const p21::Value* v) const;              // decoded; "" when it is no string
  Args list(const p21::Instance& i, const p21::Value* v) const;
  std::vector<std::int64_t> references(const p21::Instance& i, const p21::Value* v) const;  // non-references are skipped

  // Geometry, mm.
  Vec3 point(std::int64_t id) const;
  Vec3 direction(std::int64_t id) const;
  Placement placement(std::int64_t id) const;
  /// CARTESIAN_TRANSFORMATION_OPERATOR_3D; may mirror and scale.
  Eigen::Affine3d transformation(std::int64_t id) const;
  /// `is_reversed` is toggled where a trimmed curve runs against its basis.
  Curve curve(std::int64_t id, bool& is_reversed, int depth = 0) const;
  /// The PCURVE that stands for a curve without a course of its own in space; 0 where there is one.
  std::int64_t pcurve_alone(std::int64_t curve) const;
  /// The course of a PCURVE in space, over the part of it between two points (the whole, where they are the same).
  Curve curve_on_surface(std::int64_t pcurve, const Vec3& from, const Vec3& to, bool is_reversed) const;
  /// `is_reversed` is toggled where the natural normal is opposite to the one of the file.
  Surface surface(std::int64_t id, bool& is_reversed, int depth = 0) const;

 private:
  Curve bspline_curve(const p21::Instance& i) const;
  BSplineCurve bounded_curve(std::int64_t id, int depth) const;
  BSplineCurve composite_curve(const p21::Instance& i, int depth) const;
  std::pair<double, double> trim(const p21::Instance& i, const Curve& basis, double per_unit) const;
  Surface bspline_surface(const p21::Instance& i) const;
  Vec2 parameter_units(const p21::Instance& surface) const;
  std::vector<double> knots(const p21::Instance& i, const p21::Value* multiplicities, const p21::Value* values, int degree,
                            std::size_t poles) const;
  double length(const p21::Instance& i, const p21::Value* v) const;
  const p21::File& file_;
};

/// Knots of BEZIER, UNIFORM, QUASI_UNIFORM curves and surfaces by the rule of ISO 10303-42.
std::vector<double> default_knots(std::uint32_t kind, int degree, int poles);

}  // namespace asbuilt::step
