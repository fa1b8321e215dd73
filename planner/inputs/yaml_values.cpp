// SPDX-License-Identifier: GPL-3.0-or-later
// The leaves of the YAML files: numbers, words, dates, poses, covariances. Angles stay degrees here, quaternions come out unit.
#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cmath>

#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <Eigen/SVD>

#include "planner/base/number.hpp"
#include "planner/inputs/dates.hpp"
#include "planner/inputs/yaml_reader.hpp"
#include "planner/io/file.hpp"

namespace asbuilt::inputs {

namespace {

constexpr std::size_t kNodesLimit = 5'000'000;

std::string found_text(const YAML::Node& node) {
  if (node.IsScalar()) return "'" + shown(node.Scalar()) + "'";
  if (node.IsSequence()) return "a list of " + std::to_string(node.size());
  if (node.IsMap()) return "a mapping";
  return "nothing";
}

std::string plain(double v) {
  return v == std::floor(v) && std::abs(v) < 1e15 ? std::to_string(static_cast<long long>(v)) : fmt::format("{:g}", v);
}

std::string range_text(const Field& f) {
  const bool low = std::isfinite(f.min), high = std::isfinite(f.max);
  std::string text = "a number";
  if (low && high) text += " from " + plain(f.min) + " to " + plain(f.max);
  if (low && !high) text += " of at least " + plain(f.min);
  if (!low && high) text += " of at most " + plain(f.max);
  if (!f.unit.empty()) text += " " + std::string(f.unit);
  if (!f.word.empty()) text += ", or '" + std::string(f.word) + "'";
  return text;
}

std::optional<double> number_of(const std::string& text) {
  const char* begin = text.data();
  const char* end = begin + text.size();
  if (begin != end && *begin == '+') ++begin;
  double value = 0;
  const auto r = std::from_chars(begin, end, value);
  if (r.ec != std::errc() || r.ptr != end || !std::isfinite(value)) return std::nullopt;
  return value;
}

bool number_at(Readout& out, const YAML::Node& node, const std::string& field, double& value, double limit, const char* unit) {
  const std::size_t before = out.faults.size();
  read_number(out, node, field, {.unit = unit, .min = -limit, .max = limit}, value);
  return out.faults.size() == before;
}

template <std::size_t N>
bool numbers_at(Readout& out, const YAML::Node& node, const std::string& field, std::array<double, N>& values, double limit,
                const char* unit) {
  mark(out, node, field);
  if (!expect_list(out, node, field, N, false)) return false;
  bool ok = true;
  for (std::size_t i = 0; i < N; ++i) ok = number_at(out, node[i], field + "[" + std::to_string(i) + "]", values[i], limit, unit) && ok;
  return ok;
}

}  // namespace

std::string shown(std::string_view text) {
  std::string result;
  for (const char c : text.substr(0, 60)) {
    const auto u = static_cast<unsigned char>(c);
    result += (u >= 0x20 && u < 0x7f) || u >= 0x80 ? c : '?';
  }
  if (first_not_utf8(result))  // also a character cut in two by the limit
    for (char& c : result)
      if (static_cast<unsigned char>(c) >= 0x80) c = '?';
  return text.size() > 60 ? result + "..." : result;
}

void mark(Readout& out, const YAML::Node& node, const std::string& field) {
  if (++out.nodes_count == kNodesLimit) out.fault("input.too_large", field, "the file stands for too many values");
  if (node.Mark().line >= 0) out.lines.try_emplace(field, node.Mark().line + 1);
}

bool expect_list(Readout& out, const YAML::Node& node, const std::string& field, std::size_t count, bool or_more) {
  if (out.nodes_count > kNodesLimit) return false;
  if (node.IsSequence() && (or_more ? node.size() >= count : node.size() == count)) return true;
  out.fault("input.wrong_type", field,
            "found " + found_text(node) + ", allowed a list of " + (or_more ? "at least " : "") + std::to_string(count));
  return false;
}

bool expect_map(Readout& out, const YAML::Node& node, const std::string& field) {
  if (out.nodes_count > kNodesLimit) return false;
  if (node.IsMap()) return true;
  out.fault("input.wrong_type", field, "found " + found_text(node) + ", allowed a mapping of keys to values");
  return false;
}

void read_number(Readout& out, const YAML::Node& node, const std::string& field, const Field& f, double& value) {
  mark(out, node, field);
  const std::optional<double> number = node.IsScalar() ? number_of(node.Scalar()) : std::nullopt;
  if (!number) {
    out.fault("input.wrong_type", field, "found " + found_text(node) + ", allowed " + range_text(f));
    return;
  }
  if (*number < f.min || *number > f.max) {
    out.fault("input.out_of_range", field, "found " + shortest_number(*number) + ", allowed " + range_text(f), *number,
              *number < f.min ? f.min : f.max, std::string(f.unit));
    return;
  }
  value = *number;
}

void read_integer(Readout& out, const YAML::Node& node, const std::string& field, const Field& f, int& value) {
  Field limits = f;
  limits.min = std::max(f.min, -2147483647.0), limits.max = std::min(f.max, 2147483647.0);
  double number = 0;
  const std::size_t before = out.faults.size();
  read_number(out, node, field, limits, number);
  if (out.faults.size() != before) return;
  if (number != std::floor(number)) {
    out.fault("input.wrong_type", field, "found " + found_text(node) + ", allowed a whole number");
    return;
  }
  value = int(number);
}

void read_bool(Readout& out, const YAML::Node& node, const std::string& field, bool& value) {
  mark(out, node, field);
  if (const auto word = read_choice(out, node, field, {"true", "false"})) value = *word == "true";
}

std::optional<std::string> read_choice(Readout& out, const YAML::Node& node, const std::string& field,
                                       const std::vector<std::string_view>& words) {
  std::string all;
  for (const std::string_view w : words) {
    if (node.IsScalar() && node.Scalar() == w) return node.Scalar();
    all += (all.empty() ? "" : " | ") + std::string(w);
  }
  out.fault("input.not_a_choice", field, "found " + found_text(node) + ", allowed " + all);
  return std::nullopt;
}

void read_text(Readout& out, const YAML::Node& node, const std::string& field, const Field& f, std::string& value) {
  if (!node.IsScalar() || node.Scalar().empty()) {
    out.fault("input.wrong_type", field, "found " + found_text(node) + ", allowed a text");
    return;
  }
  const std::string text = node.Scalar();
  const auto all_of = [&](std::string_view extra) {
    return std::all_of(text.begin(), text.end(), [&](char c) {
      return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || extra.find(c) != std::string_view::npos;
    });
  };
  if (f.form == Form::id && (text.size() > 100 || text.front() == '.' || text.front() == '-' || !all_of("._-"))) {
    out.fault("input.bad_name", field,
              "found '" + shown(text) + "', allowed up to 100 letters, digits, '.', '_', '-', first a letter, a digit or '_'");
    return;
  }
  if (f.form == Form::edge &&
      (text.size() > 200 || std::any_of(text.begin(), text.end(), [](char c) { return static_cast<unsigned char>(c) < 0x21; }))) {
    out.fault("input.bad_name", field, "found '" + shown(text) + "', allowed an id like \"#417\" as `asbuilt cad --edges` prints it");
    return;
  }
  if (f.form == Form::date && !day_number(text)) {
    out.fault("input.bad_date", field, "found '" + shown(text) + "', allowed a day like 2026-11-22");
    return;
  }
  if (f.form == Form::file &&
      (text.size() > 1000 || std::any_of(text.begin(), text.end(), [](char c) { return static_cast<unsigned char>(c) < 0x20; }))) {
    out.fault("input.bad_path", field, "found '" + shown(text) + "', allowed a path");
    return;
  }
  value = text;
}

void read_number_or_word(Readout& out, const YAML::Node& node, const std::string& field, const Field& f, NumberOrWord& value) {
  if (node.IsScalar() && node.Scalar() == f.word) {
    mark(out, node, field);
    value = {0, true};
    return;
  }
  value.is_word = false;
  read_number(out, node, field, f, value.value);
}

void read_vec3(Readout& out, const YAML::Node& node, const std::string& field, const Field& f, Vec3& value) {
  if (!expect_list(out, node, field, 3, false)) return;
  const std::size_t before = out.faults.size();
  Vec3 v = Vec3::Zero();
  for (int i = 0; i < 3; ++i) read_number(out, node[i], field + "[" + std::to_string(i) + "]", f, v[i]);
  if (out.faults.size() != before) return;
  if (f.is_direction && !(v.norm() > 1e-9)) {
    out.fault("input.out_of_range", field, "found a direction of length 0, allowed any other");
    return;
  }
  value = v;
}

void read_matrix6(Readout& out, const YAML::Node& node, const std::string& field, const Field&, Mat6& value) {
  if (!expect_list(out, node, field, 6, false)) return;
  Mat6 m = Mat6::Zero();
  bool ok = true;
  for (int i = 0; i < 6; ++i) {
    std::array<double, 6> row{};
    ok = numbers_at(out, node[std::size_t(i)], field + "[" + std::to_string(i) + "]", row, 1e9, "") && ok;
    for (int j = 0; j < 6; ++j) m(i, j) = row[std::size_t(j)];
  }
  if (!ok) return;
  for (int i = 0; i < 6; ++i)
    for (int j = 0; j < i; ++j) {
      const double scale = std::sqrt(std::abs(m(i, i) * m(j, j))) + 1e-300;
      if (std::abs(m(i, j) - m(j, i)) > 1e-6 * scale) {
        out.fault("input.bad_covariance", field,
                  "found " + shortest_number(m(i, j)) + " at row " + std::to_string(i + 1) + ", column " + std::to_string(j + 1) + " but " +
                      shortest_number(m(j, i)) + " across the diagonal, allowed a symmetric matrix");
        return;
      }
    }
  m = 0.5 * (m + m.transpose()).eval();
  // Rows in mm and rows in rad differ by orders of magnitude: the test is on the correlation matrix.
  Vec6 sd;
  for (int i = 0; i < 6; ++i) {
    if (m(i, i) < 0 || (m(i, i) == 0 && !m.row(i).isZero(0))) {
      out.fault("input.bad_covariance", field,
                "found the variance " + shortest_number(m(i, i)) + " at row " + std::to_string(i + 1) +
                    ", allowed a positive semi-definite matrix",
                m(i, i), 0, "");
      return;
    }
    sd[i] = m(i, i) > 0 ? std::sqrt(m(i, i)) : 1.0;
  }
  const Mat6 correlation = sd.cwiseInverse().asDiagonal() * m * sd.cwiseInverse().asDiagonal();
  const double least = Eigen::SelfAdjointEigenSolver<Mat6>(correlation, Eigen::EigenvaluesOnly).eigenvalues()[0];
  if (!(least > -1e-6)) {
    out.fault("input.bad_covariance", field,
              "found a matrix whose correlation has the eigenvalue " + shortest_number(rounded(least, 9)) +
                  ", allowed a positive semi-definite matrix",
              least, 0, "");
    return;
  }
  value = m;
}

void read_pose(Readout& out, const YAML::Node& node, const std::string& field, const Field& f, PoseText& value) {
  const std::string forms = std::string("{xyz, quat: [w,x,y,z]}, {xyz, zyx: [A,B,C]}, {xyz, rpy: [Rx,Ry,Rz]}, {matrix: 4x4}") +
                            (f.allows_joints ? ", {joints: [6 angles]}" : "");
  if (!node.IsMap()) {
    out.fault("input.bad_pose", field, "found " + found_text(node) + ", allowed one of " + forms);
    return;
  }
  std::map<std::string, YAML::Node> parts;
  for (const auto& entry : node) {
    const std::string key = entry.first.IsScalar() ? entry.first.Scalar() : "?";
    const bool is_known =
        key == "xyz" || key == "quat" || key == "zyx" || key == "rpy" || key == "matrix" || (key == "joints" && f.allows_joints);
    if (!is_known || parts.count(key)) {
      out.lines[field + "." + shown(key)] = entry.first.Mark().line + 1;
      out.fault(parts.count(key) ? "input.duplicate_key" : "input.unknown_key", field + "." + shown(key),
                "found the key '" + shown(key) + "'" + (parts.count(key) ? " twice" : "") + ", allowed one of " + forms);
      return;
    }
    parts[key] = entry.second;
  }
  const auto is_form = [&](std::initializer_list<const char*> keys) {
    if (parts.size() != keys.size()) return false;
    for (const char* k : keys)
      if (!parts.count(k)) return false;
    return true;
  };
  if (is_form({"joints"})) {
    std::array<double, 6> q{};
    if (numbers_at(out, parts["joints"], field + ".joints", q, 3600, "degree")) value.joints_deg = q;
    return;
  }
  if (is_form({"matrix"})) {
    const YAML::Node& rows = parts["matrix"];
    mark(out, rows, field + ".matrix");
    if (!expect_list(out, rows, field + ".matrix", 4, false)) return;
    Eigen::Matrix4d m = Eigen::Matrix4d::Zero();
    bool ok = true;
    for (int i = 0; i < 4; ++i) {
      std::array<double, 4> row{};
      ok = numbers_at(out, rows[std::size_t(i)], field + ".matrix[" + std::to_string(i) + "]", row, 1e5, "") && ok;
      for (int j = 0; j < 4; ++j) m(i, j) = row[std::size_t(j)];
    }
    if (!ok) return;
    const Mat3 r = m.topLeftCorner<3, 3>();
    const double error = (r * r.transpose() - Mat3::Identity()).cwiseAbs().maxCoeff();
    if (!(error < 1e-4)) {
      out.fault("input.bad_pose", field + ".matrix",
                "found a matrix whose rows are not orthonormal (error " + shortest_number(rounded(error, 6)) + "), allowed a rotation",
                error, 1e-4, "");
      return;
    }
    if (r.determinant() < 0) {
      out.fault("input.bad_pose", field + ".matrix", "found a reflection (determinant -1), allowed a rotation (determinant +1)",
                r.determinant(), 1, "");
      return;
    }
    if ((m.row(3) - Eigen::RowVector4d(0, 0, 0, 1)).cwiseAbs().maxCoeff() > 1e-9) {
      out.fault("input.bad_pose", field + ".matrix", "found a last row that is not [0, 0, 0, 1], allowed a rigid motion");
      return;
    }
    const Eigen::JacobiSVD<Mat3> svd(r, Eigen::ComputeFullU | Eigen::ComputeFullV);
    value.q = Eigen::Quaterniond(Mat3(svd.matrixU() * svd.matrixV().transpose())).normalized();
    value.p_mm = m.topRightCorner<3, 1>();
    return;
  }
  std::array<double, 3> xyz{};
  if (is_form({"xyz", "quat"})) {
    std::array<double, 4> w{};
    const bool ok = numbers_at(out, parts["xyz"], field + ".xyz", xyz, 1e5, "mm");
    if (!numbers_at(out, parts["quat"], field + ".quat", w, 10, "") || !ok) return;
    Eigen::Quaterniond q(w[0], w[1], w[2], w[3]);
    if (std::abs(q.norm() - 1) > 1e-3) {
      out.fault("input.bad_pose", field + ".quat", "found a quaternion of length " + fixed_number(q.norm(), 6) + ", allowed 1 within 0.001",
                q.norm(), 1, "");
      return;
    }
    value.q = q.normalized();
  } else if (is_form({"xyz", "zyx"}) || is_form({"xyz", "rpy"})) {
    const bool is_zyx = parts.count("zyx") > 0;
    std::array<double, 3> a{};
    const bool ok = numbers_at(out, parts["xyz"], field + ".xyz", xyz, 1e5, "mm");
    if (!numbers_at(out, parts[is_zyx ? "zyx" : "rpy"], field + (is_zyx ? ".zyx" : ".rpy"), a, 3600, "degree") || !ok) return;
    if (!is_zyx) std::swap(a[0], a[2]);
    value.q = quat_from_zyx(rad_from_deg(a[0]), rad_from_deg(a[1]), rad_from_deg(a[2])).normalized();
  } else {
    out.fault("input.bad_pose", field, "found the keys of no pose, allowed one of " + forms);
    return;
  }
  value.p_mm = Vec3(xyz[0], xyz[1], xyz[2]);
}

}  // namespace asbuilt::inputs
