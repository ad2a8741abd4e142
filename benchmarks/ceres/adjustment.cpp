// The adjustment of benchmarks/adjustment_size.py by Ceres, derivatives by its automatic differentiation.
//
//   g++ -O3 -march=native -DNDEBUG -I/usr/include/eigen3 adjustment.cpp -o adjustment -lceres -lglog
//   ./adjustment PROBLEM sighting|image [RADIUS]
//
// (Debian: g++ libceres-dev.)  PROBLEM is written by benchmarks/adjustment_peers.py: little-endian, packed,
//
//   int64   n sightings, m images
//   double  focal length m, pitch m, principal point 2 px, k1 k2 k3, p1 p2: the camera as stated
//           C_EK at the start 9 (row by row), units of the 11 common unknowns, plausible ranges of the last 8
//           per image: S 9 rad, T 9 m about E's axes: attitude error S a, position error in E's axes T b
//           per sighting: pixel 2, apparent direction e_E 3, range m, whitening 4 (row by row, sigma per px)
//   int32   per sighting: its image
//
// Unknowns: 11 common ones in their units (alignment theta_E; corrections to focal length, principal point, k1, k2, k3,
// p1, p2) and (a, b) of each image, which have unit prior; the 8 numbers of the camera are held by their plausible
// range only.  With alpha = S a and rho = T b the camera sees a marker at
//
//   s_K = C_EK^T exp(-theta) exp(-alpha) (e_E + rho / range)
//   pixel = principal point + f / pitch distorted(s_x / s_z, s_y / s_z)
//
// The light effects are those of the measured position: an error of metres changes them by 1e-10 rad.
//
// Ceres is given the ordering that suits an arrow (images eliminated first, the dense rest is 11 wide) and, the start
// being good, a trust region that does not bind: Gauss-Newton steps; RADIUS is that of another one (Ceres's own: 1e4).
// Each sighting is a cost of its own, as in the
// examples of Ceres; with "image" all of an image are one cost, which shares its rotations and blocks.
//
// Prints one JSON object: whether it converged, linearisations ("passes"), chi-square, CPU seconds of the solution
// alone and of the whole process, peak memory above the table's, and the common unknowns in SI and px (C_EK is
// exp(theta_E) times that at the start).

#include <ceres/ceres.h>
#include <ceres/normal_prior.h>
#include <ceres/rotation.h>

#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <fstream>
#include <memory>
#include <string>
#include <vector>

namespace {

constexpr int kOptics = 8, kCommon = 3 + kOptics, kOwn = 6;

struct Header {
  double focal_length, pitch, principal_point[2], k[3], p[2];
  double C_EK[9], unit[kCommon], range[kOptics];
};
struct Image {
  double S[9], T[9];
};
struct Sighting {
  double pixel[2], e_E[3], range, W[4];
};
struct Table {
  Header header;
  std::vector<Image> images;
  std::vector<Sighting> sightings;
  std::vector<int32_t> image;
};

double CpuSeconds() {
  timespec t;
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
  return t.tv_sec + 1e-9 * t.tv_nsec;
}

// Largest memory held so far, by the kernel's books (getrusage counts that of the process which started this one).
double PeakMegabytes() {
  std::ifstream status("/proc/self/status");
  for (std::string line; std::getline(status, line);)
    if (line.rfind("VmHWM:", 0) == 0) return std::stod(line.substr(6)) / 1024.0;
  return 0.0;
}

template <typename T>
void ReadInto(std::FILE* file, T* values, size_t count) {
  if (std::fread(values, sizeof(T), count, file) != count) {
    std::fprintf(stderr, "the problem's file ends too early\n");
    std::exit(2);
  }
}

Table Read(const char* path) {
  std::FILE* file = std::fopen(path, "rb");
  if (file == nullptr) {
    std::perror(path);
    std::exit(2);
  }
  Table t;
  int64_t size[2];
  ReadInto(file, size, 2);
  t.sightings.resize(size[0]);
  t.image.resize(size[0]);
  t.images.resize(size[1]);
  ReadInto(file, &t.header, 1);
  ReadInto(file, t.images.data(), t.images.size());
  ReadInto(file, t.sightings.data(), t.sightings.size());
  ReadInto(file, t.image.data(), t.image.size());
  std::fclose(file);
  return t;
}

// M v, M stored row by row.
template <typename T>
void Times(const double* M, const T* v, T* product) {
  for (int i = 0; i < 3; ++i) product[i] = M[3 * i] * v[0] + M[3 * i + 1] * v[1] + M[3 * i + 2] * v[2];
}

// M^T v.
template <typename T>
void TransposedTimes(const double* M, const T* v, T* product) {
  for (int i = 0; i < 3; ++i) product[i] = M[i] * v[0] + M[3 + i] * v[1] + M[6 + i] * v[2];
}

template <typename T>
void MinusInUnits(const double* unit, const T* value, T* turn) {
  for (int i = 0; i < 3; ++i) turn[i] = -unit[i] * value[i];
}

// Whitened predicted minus measured pixel of a direction in the camera's axes.
template <typename T>
void PixelResidual(const Header& h, const Sighting& o, const T* common, const T* s_K, T* residual) {
  T c[kOptics];
  for (int i = 0; i < kOptics; ++i) c[i] = h.unit[3 + i] * common[3 + i];
  const T x = s_K[0] / s_K[2], y = s_K[1] / s_K[2], r2 = x * x + y * y;
  const T radial = 1.0 + r2 * (h.k[0] + c[3] + r2 * (h.k[1] + c[4] + r2 * (h.k[2] + c[5])));
  const T p1 = h.p[0] + c[6], p2 = h.p[1] + c[7], scale = (h.focal_length + c[0]) / h.pitch;
  const T x_d = x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x);
  const T y_d = y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y;
  const T column = scale * x_d + h.principal_point[0] + c[1] - o.pixel[0];
  const T row = scale * y_d + h.principal_point[1] + c[2] - o.pixel[1];
  residual[0] = o.W[0] * column + o.W[1] * row;
  residual[1] = o.W[2] * column + o.W[3] * row;
}

// A sighting as a cost of its own.
struct SightingCost {
  const Header* header;
  const Image* image;
  const Sighting* sighting;

  template <typename T>
  bool operator()(const T* common, const T* own, T* residual) const {
    T alpha[3], theta[3], rho[3], d[3], turned[3], s_E[3], s_K[3];
    Times(image->S, own, alpha);
    for (T& angle : alpha) angle = -angle;
    MinusInUnits(header->unit, common, theta);
    Times(image->T, own + 3, rho);
    for (int i = 0; i < 3; ++i) d[i] = sighting->e_E[i] + rho[i] / sighting->range;
    ceres::AngleAxisRotatePoint(alpha, d, turned);
    ceres::AngleAxisRotatePoint(theta, turned, s_E);
    TransposedTimes(header->C_EK, s_E, s_K);
    PixelResidual(*header, *sighting, common, s_K, residual);
    return true;
  }
};

// All sightings of an image as one cost: one rotation for all of them.
struct ImageCost {
  const Header* header;
  const Image* image;
  std::vector<const Sighting*> sightings;

  template <typename T>
  bool operator()(const T* common, const T* own, T* residual) const {
    T alpha[3], theta[3], rho[3], shift[3], C[3][3];
    Times(image->S, own, alpha);
    for (T& angle : alpha) angle = -angle;
    MinusInUnits(header->unit, common, theta);
    Times(image->T, own + 3, rho);
    for (int j = 0; j < 3; ++j) {  // columns of C_EK^T exp(-theta) exp(-alpha)
      const T axis[3] = {T(j == 0), T(j == 1), T(j == 2)};
      T turned[3], s_E[3];
      ceres::AngleAxisRotatePoint(alpha, axis, turned);
      ceres::AngleAxisRotatePoint(theta, turned, s_E);
      TransposedTimes(header->C_EK, s_E, C[j]);
    }
    for (int i = 0; i < 3; ++i) shift[i] = C[0][i] * rho[0] + C[1][i] * rho[1] + C[2][i] * rho[2];
    for (const Sighting* o : sightings) {
      T s_K[3];
      for (int i = 0; i < 3; ++i)
        s_K[i] = C[0][i] * o->e_E[0] + C[1][i] * o->e_E[1] + C[2][i] * o->e_E[2] + shift[i] / o->range;
      PixelResidual(*header, *o, common, s_K, residual);
      residual += 2;
    }
    return true;
  }
};

void AddSightings(const Table& t, double* common, std::vector<double>& own, ceres::Problem* problem) {
  using Cost = ceres::AutoDiffCostFunction<SightingCost, 2, kCommon, kOwn>;
  for (size_t i = 0; i < t.sightings.size(); ++i) {
    const int32_t j = t.image[i];
    problem->AddResidualBlock(new Cost(new SightingCost{&t.header, &t.images[j], &t.sightings[i]}), nullptr, common,
                              &own[kOwn * j]);
  }
}

void AddImages(const Table& t, double* common, std::vector<double>& own, ceres::Problem* problem) {
  using Cost = ceres::AutoDiffCostFunction<ImageCost, ceres::DYNAMIC, kCommon, kOwn>;
  std::vector<std::vector<const Sighting*>> seen(t.images.size());
  for (size_t i = 0; i < t.sightings.size(); ++i) seen[t.image[i]].push_back(&t.sightings[i]);
  for (size_t j = 0; j < t.images.size(); ++j) {
    const int rows = 2 * static_cast<int>(seen[j].size());
    auto* cost = new ImageCost{&t.header, &t.images[j], std::move(seen[j])};
    problem->AddResidualBlock(new Cost(cost, rows), nullptr, common, &own[kOwn * j]);
  }
}

void AddPriors(const Table& t, double* common, std::vector<double>& own, ceres::Problem* problem) {
  const Header& h = t.header;
  ceres::Matrix held = ceres::Matrix::Zero(kOptics, kCommon);
  for (int i = 0; i < kOptics; ++i) held(i, 3 + i) = h.unit[3 + i] / h.range[i];
  problem->AddResidualBlock(new ceres::NormalPrior(held, ceres::Vector::Zero(kCommon)), nullptr, common);
  auto* unit = new ceres::NormalPrior(ceres::Matrix::Identity(kOwn, kOwn), ceres::Vector::Zero(kOwn));
  for (size_t j = 0; j < t.images.size(); ++j) problem->AddResidualBlock(unit, nullptr, &own[kOwn * j]);
}

ceres::Solver::Options Settings(double radius, double* common, std::vector<double>& own) {
  ceres::Solver::Options options;
  options.linear_solver_type = ceres::DENSE_SCHUR;
  options.linear_solver_ordering = std::make_shared<ceres::ParameterBlockOrdering>();
  for (size_t j = 0; j < own.size(); j += kOwn) options.linear_solver_ordering->AddElementToGroup(&own[j], 0);
  options.linear_solver_ordering->AddElementToGroup(common, 1);
  options.initial_trust_region_radius = radius;
  // steps are judged by the cost, whose own rounding is some 1e-14: this leaves 1e-4 sigma, and no step is refused
  options.function_tolerance = 1e-13;
  options.parameter_tolerance = 0.0;
  options.gradient_tolerance = 0.0;
  options.num_threads = 1;
  options.logging_type = ceres::SILENT;
  return options;
}

void PrintValues(const Header& h, const double* common) {
  std::printf("\"values\": [");
  for (int i = 0; i < kCommon; ++i) std::printf("%s%.17g", i ? ", " : "", h.unit[i] * common[i]);
  std::printf("]}\n");
}

}  // namespace

int main(int argc, char** argv) {
  google::InitGoogleLogging(argv[0]);
  const std::string per = argc == 3 || argc == 4 ? argv[2] : "";
  if (per != "sighting" && per != "image") {
    std::fprintf(stderr, "usage: %s PROBLEM sighting|image [RADIUS]\n", argv[0]);
    return 2;
  }
  const double radius = argc == 4 ? std::atof(argv[3]) : 1e16;
  const Table table = Read(argv[1]);
  const double before_mb = PeakMegabytes();
  double common[kCommon] = {};
  std::vector<double> own(kOwn * table.images.size(), 0.0);
  ceres::Problem problem;
  (per == "image" ? AddImages : AddSightings)(table, common, own, &problem);
  AddPriors(table, common, own, &problem);
  ceres::Solver::Summary summary;
  const double start = CpuSeconds();
  ceres::Solve(Settings(radius, common, own), &problem, &summary);
  const double end = CpuSeconds();
  std::printf("{\"converged\": %s, ", summary.termination_type == ceres::CONVERGENCE ? "true" : "false");
  std::printf("\"passes\": %d, \"chi2\": %.17g, ", summary.num_jacobian_evaluations, 2.0 * summary.final_cost);
  std::printf("\"solve_s\": %.3f, \"total_s\": %.3f, ", end - start, end);
  std::printf("\"memory_mb\": %.0f, ", PeakMegabytes() - before_mb);
  PrintValues(table.header, common);
  return 0;
}
