// SPDX-License-Identifier: GPL-3.0-or-later
// Unknowns x: part's twist (6), robot parameters (n), faces (7 each). The cells speak about y: part's twist, one twist by
// capture, faces; capture twists are linear in the robot parameters. Normal equations are gathered in y (sparse rows) and
// carried over to x once per step.
#include "planner/locate/adjust.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <variant>

namespace asbuilt {
namespace {

constexpr int kFace = 7;
constexpr double kCaptureTuning = 3.0, kCellTuning = 4.0;  // robust losses bend here, in sd
constexpr double kMedianOfChiSquare = 0.4549;              // one degree of freedom

/// Rounds: how far points may lie and how generous the robust scale is, step by step.
struct Stage {
  double gate_ratio;
  std::vector<double> slack_mm;
};
const Stage kStages[] = {{1.0, {1.0, 0.5, 0.3}}, {0.6, {0.2, 0.1}}, {0.45, {0.05, 0.02}}, {0.45, {0.0, 0.0}}, {0.45, {0.0, 0.0}}, {0.45, {0.0, 0.0}}, {0.45, {0.0, 0.0}}};
constexpr int kLearningStages = 4;  // sizes of the imperfections are held from here on
constexpr double kStillMm = 0.003, kConvergedMm = 0.02;
/// Where the part still moves after all stages (a direction that few cells hold, cells that come and go at the gate): more rounds, by
/// halved steps from the second on.
constexpr int kMoreRounds = 12;

double robust_weight(double residual, double scale, double tuning) {
  const double u = residual / (tuning * scale);
  const double w = 1.0 / (1.0 + u * u);
  return w * w;
}

double median_of(std::vector<double> v) {
  if (v.empty()) return 0;
  std::nth_element(v.begin(), v.begin() + static_cast<std::ptrdiff_t>(v.size() / 2), v.end());
  return v[v.size() / 2];
}

/// The sd that readings of known own variance show beyond it, by a median in which precise readings count more. The second
/// of each pair is the own variance, the first the squared reading.
double hidden_sd(const std::vector<std::pair<double, double>>& readings, double least, double most) {
  constexpr int kSteps = 60;
  for (int k = kSteps; k >= 0; --k) {
    const double sd = least * std::pow(most / least, static_cast<double>(k) / kSteps);
    double balance = 0;
    for (const auto& [square, own] : readings) {
      const double all = own + sd * sd, share = sd * sd / all;
      balance += share * share * (square > kMedianOfChiSquare * all ? 0.5 : -0.5);
    }
    if (balance >= 0 && !readings.empty()) return sd;
  }
  return least;
}

// Of the faces' deviations: how much of one a free-form face has within itself, and within one patch.
constexpr double kBendRatio = 0.5, kBendInPatchRatio = 0.15;

bool is_free_form(const CadModel& cad, int face) {
  if (face < 0 || face >= static_cast<int>(cad.brep->faces.size())) return false;
  const auto& shape = cad.brep->faces[static_cast<std::size_t>(face)].surface.shape;
  return !std::holds_alternative<PlaneSurface>(shape) && !std::holds_alternative<CylinderSurface>(shape) &&
         !std::holds_alternative<ConeSurface>(shape) && !std::holds_alternative<SphereSurface>(shape) && !std::holds_alternative<TorusSurface>(shape);
}

struct Row {
  Vec6 wrench;
  Eigen::Matrix<double, kFace, 1> face;
};

/// A row of y in blocks; adding to a block that is there already adds up.
struct SparseRow {
  std::vector<int> at, first;  // first: beginnings of blocks
  std::vector<std::size_t> where;
  std::vector<double> value;

  void clear() { at.clear(), first.clear(), where.clear(), value.clear(); }
  template <class V>
  void add(int begin, const V& v) {
    const std::size_t to = block(begin, static_cast<int>(v.size()));
    for (int i = 0; i < static_cast<int>(v.size()); ++i) value[to + static_cast<std::size_t>(i)] += v[i];
  }
  void add(const SparseRow& other, double factor) {
    for (std::size_t k = 0; k < other.first.size(); ++k) {
      const std::size_t from = other.where[k], end = k + 1 < other.where.size() ? other.where[k + 1] : other.at.size();
      const std::size_t to = block(other.first[k], static_cast<int>(end - from));
      for (std::size_t i = from; i < end; ++i) value[to + i - from] += factor * other.value[i];
    }
  }

 private:
  std::size_t block(int begin, int count) {
    for (std::size_t k = 0; k < first.size(); ++k)
      if (first[k] == begin) return where[k];
    first.push_back(begin), where.push_back(at.size());
    for (int i = 0; i < count; ++i) at.push_back(begin + i), value.push_back(0);
    return where.back();
  }
};

class Adjustment {
 public:
  explicit Adjustment(const AdjustRequest& request)
      : request_(request), cad_(*request.cad), prior_(*request.prior), captures_(static_cast<int>(request.cloud->captures.size())),
        faces_(static_cast<int>(request.cad->face_centers.size())) {
    AdjustState& s = out_.state;
    s.T_base_part = request.start;
    s.robot = Eigen::VectorXd::Zero(prior_.size);
    s.faces = Eigen::VectorXd::Zero(kFace * faces_);
    s.sensor_factor.assign(prior_.sensor_at.size(), 1.0);
    robot_information_ = prior_.covariance.llt().solve(Eigen::MatrixXd::Identity(prior_.size, prior_.size));
    map_.resize(6 * captures_, prior_.size);
    for (int k = 0; k < captures_; ++k) map_.middleRows(6 * k, 6) = prior_.capture[static_cast<std::size_t>(k)];
  }

  Adjusted run() {
    AdjustState& s = out_.state;
    const int stages = static_cast<int>(std::size(kStages));
    for (int stage = 0; stage < stages; ++stage) {
      associate(std::max(0.5, kStages[stage].gate_ratio * request_.gate_mm));
      if (out_.clusters.size() < 12) {  // nothing to adjust with
        s.cluster_count = out_.clusters.size();
        return std::move(out_);
      }
      Vec6 moved_by = Vec6::Zero();
      for (const double slack : kStages[stage].slack_mm) {
        moved_by += step(slack);
        if (stage > 0 && stage < kLearningStages) learn_sizes();
      }
      s.step_mm = length_of(moved_by);
      if (stage >= 3 && s.step_mm < kStillMm) break;
    }
    for (int round = 0; round < kMoreRounds && s.step_mm >= kConvergedMm; ++round) {
      associate(std::max(0.5, kStages[stages - 1].gate_ratio * request_.gate_mm));
      s.step_mm = length_of(step(0.0, round == 0 ? 1.0 : 0.5) + step(0.0, round == 0 ? 1.0 : 0.5));
    }
    out_.is_converged = s.step_mm < kConvergedMm;
    finish();
    return std::move(out_);
  }

 private:
  void associate(double gate_mm) {
    ClusterRequest r;
    r.cloud = request_.cloud, r.cad = &cad_, r.T_base_part = out_.state.T_base_part, r.center_base = prior_.center_base;
    r.gate_mm = gate_mm, r.edge_band_mm = request_.edge_band_mm;
    for (int k = 0; k < captures_; ++k) r.twists.push_back(out_.state.capture_twist(prior_, k));
    out_.clusters = make_clusters(r);
    rows_.clear();
    for (const Cluster& c : out_.clusters) rows_.push_back({c.wrench, face_row(cad_, c.face, c.p_part, c.n_part)});
    face_seen_.assign(static_cast<std::size_t>(faces_), 0);
    for (const Cluster& c : out_.clusters) ++face_seen_[static_cast<std::size_t>(c.face)];
    part_twist_ = Vec6::Zero();
    cells_.clear(), patches_.clear();
    for (std::size_t i = 0; i < out_.clusters.size();) {
      const Cluster& first = out_.clusters[i];
      std::size_t j = i + 1;
      while (j < out_.clusters.size() && out_.clusters[j].face == first.face && out_.clusters[j].cell == first.cell) ++j;
      const bool is_new = i == 0 || out_.clusters[i - 1].face != first.face || out_.clusters[i - 1].patch != first.patch;
      if (is_new) patches_.emplace_back(cells_.size(), cells_.size());
      cells_.emplace_back(i, j);
      patches_.back().second = cells_.size();
      i = j;
    }
  }

  /// Of the offset that a patch of this face may have beyond what the face's own parameters say. A free-form face bends: were its
  /// patches held stiff, a smooth deviation would be explained by a shift of the part along it, many times as large.
  double patch_sd(int face) const {
    const AdjustState& s = out_.state;
    return is_free_form(cad_, face) ? std::max(s.patch_sd_mm, kBendRatio * s.form_sd_mm) : s.patch_sd_mm;
  }

  double cell_sd(int face) const {
    const AdjustState& s = out_.state;
    return is_free_form(cad_, face) ? std::max(s.cell_sd_mm, kBendInPatchRatio * s.form_sd_mm) : s.cell_sd_mm;
  }

  double variance(const Cluster& c) const {
    const double f = out_.state.sensor_factor[static_cast<std::size_t>(request_.cloud->captures[static_cast<std::size_t>(c.capture)].sensor)];
    return f * f * c.variance_mm2;
  }

  /// Distances left over by part, captures and faces, before the cells' own offsets.
  void residuals() {
    const AdjustState& s = out_.state;
    std::vector<Vec6> twists;
    for (int k = 0; k < captures_; ++k) twists.push_back(s.capture_twist(prior_, k));
    left_.resize(out_.clusters.size());
    for (std::size_t i = 0; i < left_.size(); ++i) {
      const Cluster& c = out_.clusters[i];
      left_[i] = c.distance_mm + c.wrench.dot(twists[static_cast<std::size_t>(c.capture)] - part_twist_) -
                 rows_[i].face.dot(s.faces.segment<kFace>(kFace * c.face));
    }
  }

  void reweigh(double slack_mm) {
    residuals();
    const double slack = slack_mm * slack_mm;
    out_.weight.assign(left_.size(), 1.0);
    out_.residual_mm.assign(left_.size(), 0.0);
    std::vector<double> here;
    for (const auto& [first_cell, last_cell] : patches_) {
      const std::size_t first = cells_[first_cell].first, last = cells_[last_cell - 1].second;
      const double stiff = patch_sd(out_.clusters[first].face), patch = stiff * stiff + slack;
      const double own_cell = cell_sd(out_.clusters[first].face), cell = own_cell * own_cell + slack;
      here.assign(left_.begin() + static_cast<std::ptrdiff_t>(first), left_.begin() + static_cast<std::ptrdiff_t>(last));
      double q = last - first >= 3 ? median_of(here) : 0.0;  // the patch's own offset
      for (int pass = 0; pass < 3; ++pass) {
        double patch_sum = 0, patch_total = 1 / patch;
        for (std::size_t c = first_cell; c < last_cell; ++c) {
          const auto [b, e] = cells_[c];
          here.assign(left_.begin() + static_cast<std::ptrdiff_t>(b), left_.begin() + static_cast<std::ptrdiff_t>(e));
          double o = e - b >= 3 ? median_of(here) - q : out_.residual_mm[b];  // the cell's beyond it
          for (int inner = 0; inner < 2; ++inner) {
            double sum = 0, total = 1 / cell;
            for (std::size_t i = b; i < e; ++i) {
              const double own = variance(out_.clusters[i]) + slack;
              const double among = e - b > 1 ? robust_weight(left_[i] - q - o, std::sqrt(own), kCaptureTuning) : 1.0;
              out_.weight[i] = among * robust_weight(left_[i] - q, std::sqrt(own + cell), kCellTuning) *
                               robust_weight(left_[i], std::sqrt(own + cell + patch), kCellTuning);
              sum += out_.weight[i] * (left_[i] - q) / own, total += out_.weight[i] / own;
            }
            o = sum / total;
          }
          double sum = 0, total = 0;
          for (std::size_t i = b; i < e; ++i) {
            const double own = variance(out_.clusters[i]) + slack;
            sum += out_.weight[i] * left_[i] / own, total += out_.weight[i] / own;
            out_.residual_mm[i] = left_[i] - q - o;
          }
          const double share = 1 / (1 + total * cell);  // of the cell's information that speaks about the patch
          patch_sum += sum * share, patch_total += total * share;
        }
        q = patch_sum / patch_total;
      }
    }
  }

  /// Normal equations in y = [part | captures | faces] around the present state.
  void gather() {
    const int n = 6 + 6 * captures_ + kFace * faces_;
    H_ = Eigen::MatrixXd::Zero(n, n);
    g_ = Eigen::VectorXd::Zero(n);
    SparseRow cell, patch;
    for (const auto& [first_cell, last_cell] : patches_) {
      const int face_at = 6 + 6 * captures_ + kFace * out_.clusters[cells_[first_cell].first].face;
      patch.clear();
      const double stiff = patch_sd(out_.clusters[cells_[first_cell].first].face), patch_information = 1.0 / (stiff * stiff);
      const double own_cell = cell_sd(out_.clusters[cells_[first_cell].first].face), cell_information = 1.0 / (own_cell * own_cell);
      double patch_total = patch_information, patch_right = 0;
      for (std::size_t k = first_cell; k < last_cell; ++k) {
        const auto [b, e] = cells_[k];
        double total = 0, right = 0;
        cell.clear();
        for (std::size_t i = b; i < e; ++i) {
          const Cluster& c = out_.clusters[i];
          const double w = out_.weight[i] / variance(c);
          const int capture_at = 6 + 6 * c.capture;
          const Mat6 ww = w * c.wrench * c.wrench.transpose();
          const Eigen::Matrix<double, 6, kFace> wf = w * c.wrench * rows_[i].face.transpose();
          H_.block<6, 6>(0, 0) += ww;
          H_.block<6, 6>(0, capture_at) -= ww;
          H_.block<6, 6>(capture_at, capture_at) += ww;
          H_.block<6, kFace>(0, face_at) += wf;
          H_.block<6, kFace>(capture_at, face_at) -= wf;
          H_.block<kFace, kFace>(face_at, face_at) += w * rows_[i].face * rows_[i].face.transpose();
          const double r = w * left_[i];
          g_.segment<6>(0) -= r * c.wrench;
          g_.segment<6>(capture_at) += r * c.wrench;
          g_.segment<kFace>(face_at) -= r * rows_[i].face;
          cell.add(0, -w * c.wrench);
          cell.add(capture_at, w * c.wrench);
          cell.add(face_at, -w * rows_[i].face);
          total += w, right += r;
        }
        const double all = total + cell_information;
        take_off(cell, right, all);
        const double share = cell_information / all;
        patch.add(cell, share);
        patch_total += total * share, patch_right += right * share;
      }
      take_off(patch, patch_right, patch_total);
    }
    H_ = H_.selfadjointView<Eigen::Upper>();
  }

  /// Eliminates one offset whose rows sum up to `row`.
  void take_off(const SparseRow& row, double right, double total) {
    for (std::size_t a = 0; a < row.at.size(); ++a) {
      g_[row.at[a]] -= row.value[a] * right / total;
      const double scaled = row.value[a] / total;
      for (std::size_t d = 0; d < row.at.size(); ++d)
        if (row.at[d] >= row.at[a]) H_(row.at[a], row.at[d]) -= scaled * row.value[d];
    }
  }

  Eigen::VectorXd face_information() const {
    const AdjustState& s = out_.state;
    Eigen::VectorXd information(kFace * faces_);
    for (int f = 0; f < faces_; ++f) {
      const double sd = s.form_sd_mm, turn = sd / std::max(5.0, cad_.face_radii_mm[static_cast<std::size_t>(f)]);
      information.segment<kFace>(kFace * f) << 1 / (sd * sd), Vec3::Constant(1 / (turn * turn)), Vec3::Constant(1 / (sd * sd));
    }
    return information;
  }

  /// Normal equations in x, priors added.
  void carry_over() {
    const int n = prior_.size, k6 = 6 * captures_, nf = kFace * faces_;
    A_.resize(6 + n + nf, 6 + n + nf);
    b_.resize(6 + n + nf);
    const Eigen::MatrixXd zz = H_.block(6, 6, k6, k6) * map_;
    A_.block(0, 0, 6, 6) = H_.block(0, 0, 6, 6) + request_.part_prior_information;
    A_.block(0, 6, 6, n) = H_.block(0, 6, 6, k6) * map_;
    A_.block(0, 6 + n, 6, nf) = H_.block(0, 6 + k6, 6, nf);
    A_.block(6, 6, n, n) = map_.transpose() * zz + robot_information_;
    A_.block(6, 6 + n, n, nf) = map_.transpose() * H_.block(6, 6 + k6, k6, nf);
    A_.block(6 + n, 6 + n, nf, nf) = H_.block(6 + k6, 6 + k6, nf, nf);
    const Eigen::VectorXd information = face_information();
    A_.diagonal().tail(nf) += information;
    A_ = A_.selfadjointView<Eigen::Upper>();
    b_.head(6) = g_.head(6);
    b_.segment(6, n) = map_.transpose() * g_.segment(6, k6) + robot_information_ * out_.state.robot;
    b_.tail(nf) = g_.tail(nf) + information.cwiseProduct(out_.state.faces);
  }

  /// Of a motion at the part's corners.
  double length_of(const Vec6& twist) const { return twist.head<3>().norm() + 0.5 * cad_.size_mm * twist.tail<3>().norm(); }

  /// Takes a share of one Gauss-Newton step; gives the whole step's twist of the part.
  Vec6 step(double slack_mm, double share = 1.0) {
    AdjustState& s = out_.state;
    reweigh(slack_mm);
    gather();
    carry_over();
    solver_.compute(A_);
    const Eigen::VectorXd x = -share * solver_.solve(b_);
    part_twist_ += x.head<6>();
    s.robot += x.segment(6, prior_.size);
    s.faces += x.tail(kFace * faces_);
    // The pose takes the twist at once; what the cells were associated at stays, so their part twist is kept beside it.
    const Pose<frame::Base, frame::Base> motion = pose_of_twist(x.head<6>(), prior_.center_base);
    s.T_base_part = motion * s.T_base_part;
    return x.head<6>() / share;
  }

  void learn_sizes() {
    AdjustState& s = out_.state;
    residuals();
    // Cells and patches: spread of the offsets that each asks for, its own variance taken off.
    std::vector<std::pair<double, double>> cells, patches;  // squared offset, its own variance
    std::vector<std::vector<double>> ratio(s.sensor_factor.size());
    const double cell_variance = s.cell_sd_mm * s.cell_sd_mm;
    for (const auto& [first_cell, last_cell] : patches_) {
      std::vector<std::pair<double, double>> offsets;  // mean, its variance as a reading of the cell
      double patch_sum = 0, patch_total = 0;
      for (std::size_t k = first_cell; k < last_cell; ++k) {
        const auto [b, e] = cells_[k];
        double sum = 0, total = 0;
        for (std::size_t i = b; i < e; ++i) {
          if (out_.weight[i] < 0.1) continue;
          const double w = 1 / variance(out_.clusters[i]);
          sum += w * left_[i], total += w;
        }
        if (total <= 0) continue;
        offsets.emplace_back(sum / total, 1 / total);
        const double w = 1 / (1 / total + cell_variance);
        patch_sum += w * sum / total, patch_total += w;
        for (std::size_t i = b; i < e; ++i)
          for (std::size_t j = i + 1; j < e; ++j) {
            const int a = sensor_of(i), d = sensor_of(j);
            if (a != d) continue;
            const double r = left_[i] - left_[j];
            ratio[static_cast<std::size_t>(a)].push_back(r * r / (out_.clusters[i].variance_mm2 + out_.clusters[j].variance_mm2));
          }
      }
      if (patch_total <= 0) continue;
      const double mean = patch_sum / patch_total, n = static_cast<double>(offsets.size());
      if (is_free_form(cad_, out_.clusters[cells_[first_cell].first].face)) continue;
      // Of the patch's own variance as a reading: what its cells' sensors and spread leave, not the patch's deviation.
      patches.emplace_back(mean * mean, 1 / patch_total);
      if (offsets.size() < 3) continue;
      for (const auto& [offset, own] : offsets) cells.emplace_back((offset - mean) * (offset - mean) * n / (n - 1), own);
    }
    s.cell_sd_mm = hidden_sd(cells, 0.003, 0.5);
    s.patch_sd_mm = hidden_sd(patches, 0.003, 0.5);
    for (std::size_t a = 0; a < ratio.size(); ++a)
      if (ratio[a].size() >= 50) s.sensor_factor[a] = std::clamp(std::sqrt(median_of(ratio[a]) / kMedianOfChiSquare), 1.0, 10.0);
    // Faces: offsets by expectation and maximisation (estimate plus its own variance).
    double total = 0;
    int count = 0;
    const int first = 6 + prior_.size;
    for (int f = 0; f < faces_; ++f) {
      if (face_seen_[static_cast<std::size_t>(f)] < 6) continue;
      const int at = first + kFace * f;
      Eigen::VectorXd unit = Eigen::VectorXd::Zero(A_.rows());
      unit[at] = 1;
      const double own = solver_.solve(unit)[at];
      total += s.faces[kFace * f] * s.faces[kFace * f] + own;
      ++count;
    }
    if (count >= 3) s.form_sd_mm = std::clamp(std::sqrt((total + 4 * 0.1 * 0.1) / (count + 4)), 0.02, 1.5);
  }

  int sensor_of(std::size_t i) const { return request_.cloud->captures[static_cast<std::size_t>(out_.clusters[i].capture)].sensor; }

  void finish() {
    AdjustState& s = out_.state;
    reweigh(0.0);
    gather();
    carry_over();
    solver_.compute(A_);
    const int kept = 6 + prior_.size;
    Eigen::MatrixXd unit = Eigen::MatrixXd::Zero(A_.rows(), kept);
    unit.topRows(kept).setIdentity();
    s.covariance = solver_.solve(unit).topRows(kept);
    s.covariance = 0.5 * (s.covariance + s.covariance.transpose()).eval();
    // Part's own information: everything else eliminated.
    s.data_information = s.covariance.topLeftCorner<6, 6>().inverse() - request_.part_prior_information;
    double sum = 0, weight = 0, shared = 0, inlier = 0;
    for (const auto& [b, e] : cells_) {
      for (std::size_t i = b; i < e; ++i) {
        sum += out_.weight[i] * left_[i] * left_[i], weight += out_.weight[i];
        inlier += out_.weight[i] > 0.25;
        for (std::size_t j = i + 1; j < e; ++j) {
          if (out_.clusters[i].variance_mm2 > 4e-4 || out_.clusters[j].variance_mm2 > 4e-4) continue;  // fine sensors only
          const double r = left_[i] - left_[j];
          if (out_.weight[i] < 0.1 || out_.weight[j] < 0.1) continue;
          shared += r * r;
          ++s.shared_count;
        }
      }
    }
    s.rms_mm = weight > 0 ? std::sqrt(sum / weight) : 0.0;
    s.shared_rms_mm = s.shared_count > 0 ? std::sqrt(shared / (2.0 * static_cast<double>(s.shared_count))) : 0.0;
    s.cell_count = cells_.size(), s.cluster_count = out_.clusters.size();
    s.inlier_ratio = out_.clusters.empty() ? 0.0 : inlier / static_cast<double>(out_.clusters.size());
  }

  const AdjustRequest& request_;
  const CadModel& cad_;
  const RobotPrior& prior_;
  int captures_, faces_;
  Adjusted out_;
  std::vector<Row> rows_;
  std::vector<std::pair<std::size_t, std::size_t>> cells_;    // ranges of clusters
  std::vector<std::pair<std::size_t, std::size_t>> patches_;  // ranges of cells
  std::vector<int> face_seen_;
  std::vector<double> left_;
  Vec6 part_twist_ = Vec6::Zero();
  Eigen::MatrixXd robot_information_, map_, H_, A_;
  Eigen::VectorXd g_, b_;
  Eigen::LDLT<Eigen::MatrixXd> solver_;
};

}  // namespace

Eigen::Matrix<double, 7, 1> face_row(const CadModel& cad, int face, const Vec3& p_part, const Vec3& n_part) {
  Eigen::Matrix<double, 7, 1> row = Eigen::Matrix<double, 7, 1>::Zero();
  row[0] = 1;
  row.segment<3>(1) = (p_part - cad.face_centers[static_cast<std::size_t>(face)]).cross(n_part);
  const bool is_plane = face < static_cast<int>(cad.brep->faces.size()) && cad.brep->faces[static_cast<std::size_t>(face)].surface.shape.index() == 0;
  if (!is_plane) row.tail<3>() = n_part;  // a plane's shift is its offset
  return row;
}

Adjusted adjust(const AdjustRequest& request) { return Adjustment(request).run(); }

}  // namespace asbuilt
