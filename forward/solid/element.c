/* The Q2-P1 hex, perturbed Lagrangian, pressure condensed: nodal values in, tangent and nodal forces out.

   Total Lagrangian, 3 x 3 x 3 Gauss points. The pressure of a hex is p = N . q, N = [1, X - Xc] in mm, with Xc its
   centre node. With W(F, p) = psi(F) + p (J - 1) the potential of a hex is int W - p^2 / (2 kappa) dV, and

     f  = int P : grad(v)          e = int N (J - 1 - p / kappa)
     B  = int N (dJ/dF : grad(v))  M = int N N^T
     step of the pressure          dq = kappa M^-1 (e + B du)
     condensed tangent             K  = int grad(v) : D : grad(u) + kappa B^T M^-1 B
     condensed force               g  = f + kappa B^T M^-1 e

   P and D, the derivatives of W to F, come from `law`, compiled from UFL: in w = [F (9), p], out [P (9), D (45, the
   upper triangle by rows)]. Rows of P and F: component of displacement, columns: reference direction. */

#include <math.h>
#include <stdint.h>
#include <string.h>

#define NODES 27
#define PADDED 28
#define POINTS 27
#define DOFS 81
#define PRESSURES 4
#define LAW (9 + 45)
#define WIDE 12 /* 9, padded */
#define SUMMED (3 * POINTS)
#define ROW (3 * PADDED) /* a row over components, then nodes */

typedef void (*point_law)(double*, const double*, const double*, const double*, const int*, const uint8_t*, void*);

typedef struct {
  int32_t n_cells;
  const double* points;        /* (n, 3) geometry nodes */
  const int32_t* geometry;     /* (n_cells, 27) their numbers */
  const int32_t* dofs;         /* (n_cells, 27) blocks of the displacement */
  const double* gradients;     /* (27 points, 3, 27 nodes) to the reference coordinates */
  const double* shapes;        /* (27 points, 27 nodes) */
  const double* weights;       /* (27,) */
  int32_t centre;              /* place of the centre node in a cell */
  double kappa;
  const double* parameters;
  point_law law;
} solid_t;

typedef struct {
  double G[SUMMED][PADDED] __attribute__((aligned(64))); /* gradient of the nodes' functions, row 3 q + J */
  double N[POINTS][PRESSURES];
  double F[POINTS][9], J[POINTS], cofactor[POINTS][9], volume[POINTS], p[POINTS];
  double M[PRESSURES][PRESSURES]; /* lower Cholesky factor */
} cell_t;

static double invert(const double a[9], double inverse[9])
{
  const double c0 = a[4] * a[8] - a[5] * a[7], c1 = a[5] * a[6] - a[3] * a[8], c2 = a[3] * a[7] - a[4] * a[6];
  const double det = a[0] * c0 + a[1] * c1 + a[2] * c2, f = 1 / det;
  inverse[0] = f * c0; inverse[1] = f * (a[2] * a[7] - a[1] * a[8]); inverse[2] = f * (a[1] * a[5] - a[2] * a[4]);
  inverse[3] = f * c1; inverse[4] = f * (a[0] * a[8] - a[2] * a[6]); inverse[5] = f * (a[2] * a[3] - a[0] * a[5]);
  inverse[6] = f * c2; inverse[7] = f * (a[1] * a[6] - a[0] * a[7]); inverse[8] = f * (a[0] * a[4] - a[1] * a[3]);
  return det;
}

static void cholesky(double M[PRESSURES][PRESSURES])
{
  for (int i = 0; i < PRESSURES; ++i)
    for (int j = 0; j <= i; ++j) {
      double s = M[i][j];
      for (int k = 0; k < j; ++k) s -= M[i][k] * M[j][k];
      M[i][j] = i == j ? sqrt(s) : s / M[j][j];
    }
}

static void forward_substitution(const double L[PRESSURES][PRESSURES], double x[PRESSURES])
{
  for (int i = 0; i < PRESSURES; ++i) {
    for (int k = 0; k < i; ++k) x[i] -= L[i][k] * x[k];
    x[i] /= L[i][i];
  }
}

static void backward_substitution(const double L[PRESSURES][PRESSURES], double x[PRESSURES])
{
  for (int i = PRESSURES - 1; i >= 0; --i) {
    for (int k = i + 1; k < PRESSURES; ++k) x[i] -= L[k][i] * x[k];
    x[i] /= L[i][i];
  }
}

/* Kinematics of a cell; 0 if every det F is positive (and a number). */
static int kinematics(const solid_t* s, int cell, const double* u, const double* q, cell_t* c)
{
  double x[3][NODES], v[3][NODES], centre[3];
  const int32_t* nodes = s->geometry + (int64_t)NODES * cell;
  const int32_t* blocks = s->dofs + (int64_t)NODES * cell;
  int bad = 0;
  for (int a = 0; a < NODES; ++a)
    for (int i = 0; i < 3; ++i) {
      x[i][a] = s->points[3 * (int64_t)nodes[a] + i];
      v[i][a] = u[3 * (int64_t)blocks[a] + i];
    }
  for (int i = 0; i < 3; ++i) centre[i] = x[i][s->centre];
  memset(c->M, 0, sizeof c->M);
  for (int t = 0; t < POINTS; ++t) {
    const double* slopes = s->gradients + t * 3 * NODES;
    const double* shapes = s->shapes + t * NODES;
    double map[9], back[9], H[9];
    for (int i = 0; i < 3; ++i)
      for (int k = 0; k < 3; ++k) {
        double sum = 0;
        for (int a = 0; a < NODES; ++a) sum += x[i][a] * slopes[k * NODES + a];
        map[3 * i + k] = sum;
      }
    const double dV = s->weights[t] * invert(map, back);
    for (int J = 0; J < 3; ++J) {
      double* row = c->G[3 * t + J];
      for (int a = 0; a < NODES; ++a)
        row[a] = slopes[a] * back[J] + slopes[NODES + a] * back[3 + J] + slopes[2 * NODES + a] * back[6 + J];
      row[NODES] = 0;
      for (int i = 0; i < 3; ++i) {
        double sum = 0;
        for (int a = 0; a < NODES; ++a) sum += v[i][a] * row[a];
        c->F[t][3 * i + J] = sum + (i == J);
      }
    }
    c->J[t] = invert(c->F[t], H);
    if (!(c->J[t] > 0) || !(dV > 0)) bad = 1;
    for (int i = 0; i < 3; ++i)
      for (int J = 0; J < 3; ++J) c->cofactor[t][3 * i + J] = c->J[t] * H[3 * J + i];
    c->volume[t] = dV;
    c->N[t][0] = 1;
    for (int i = 0; i < 3; ++i) {
      double sum = 0;
      for (int a = 0; a < NODES; ++a) sum += x[i][a] * shapes[a];
      c->N[t][1 + i] = sum - centre[i];
    }
    c->p[t] = 0;
    for (int m = 0; m < PRESSURES; ++m) c->p[t] += c->N[t][m] * q[PRESSURES * (int64_t)cell + m];
    for (int m = 0; m < PRESSURES; ++m)
      for (int n = 0; n <= m; ++n) c->M[m][n] += dV * c->N[t][m] * c->N[t][n];
  }
  cholesky(c->M);
  return bad;
}

/* e (4), of the volume. */
static void volume_error(const solid_t* s, const cell_t* c, double e[PRESSURES])
{
  memset(e, 0, PRESSURES * sizeof(double));
  for (int t = 0; t < POINTS; ++t) {
    const double value = c->volume[t] * (c->J[t] - 1 - c->p[t] / s->kappa);
    for (int m = 0; m < PRESSURES; ++m) e[m] += value * c->N[t][m];
  }
}

/* B (4, 84): row m; component, node. */
static void coupling(const cell_t* c, double B[PRESSURES][ROW])
{
  memset(B, 0, PRESSURES * ROW * sizeof(double));
  for (int t = 0; t < POINTS; ++t)
    for (int m = 0; m < PRESSURES; ++m)
      for (int i = 0; i < 3; ++i)
        for (int J = 0; J < 3; ++J) {
          const double f = c->volume[t] * c->N[t][m] * c->cofactor[t][3 * i + J];
          const double* row = c->G[3 * t + J];
          for (int a = 0; a < PADDED; ++a) B[m][PADDED * i + a] += f * row[a];
        }
}

/* P and D at a Gauss point; the law adds to what it is given. */
static void evaluate(const solid_t* s, const cell_t* c, int t, double result[LAW])
{
  double w[10];
  memcpy(w, c->F[t], sizeof c->F[t]);
  w[9] = c->p[t];
  memset(result, 0, LAW * sizeof(double));
  s->law(result, w, s->parameters, 0, 0, 0, 0);
}

static void add_forces(const cell_t* c, int t, const double* P, double f[ROW])
{
  for (int i = 0; i < 3; ++i)
    for (int J = 0; J < 3; ++J) {
      const double w = c->volume[t] * P[3 * i + J];
      const double* row = c->G[3 * t + J];
      for (int a = 0; a < PADDED; ++a) f[PADDED * i + a] += w * row[a];
    }
}

/* Nodal forces f, (n, 3), added to `forces`; sums[0] gains e M^-1 e, the squared volume error.
   Returns the number of cells that are turned inside out. */
int32_t solid_forces(const solid_t* s, const double* u, const double* q, double* forces, double* sums)
{
  int32_t bad = 0;
  cell_t c;
  double result[LAW], f[ROW], e[PRESSURES];
  for (int cell = 0; cell < s->n_cells; ++cell) {
    bad += kinematics(s, cell, u, q, &c);
    memset(f, 0, sizeof f);
    for (int t = 0; t < POINTS; ++t) {
      evaluate(s, &c, t, result);
      add_forces(&c, t, result, f);
    }
    volume_error(s, &c, e);
    forward_substitution(c.M, e);
    for (int m = 0; m < PRESSURES; ++m) sums[0] += e[m] * e[m];
    const int32_t* blocks = s->dofs + (int64_t)NODES * cell;
    for (int a = 0; a < NODES; ++a)
      for (int i = 0; i < 3; ++i) forces[3 * (int64_t)blocks[a] + i] += f[PADDED * i + a];
  }
  return bad;
}

/* Step dq (n_cells, 4) of the pressure that goes with the step du (n, 3) from u, q. */
void solid_pressure_step(const solid_t* s, const double* u, const double* q, const double* du, double* dq)
{
  cell_t c;
  double B[PRESSURES][ROW], e[PRESSURES];
  for (int cell = 0; cell < s->n_cells; ++cell) {
    const int32_t* blocks = s->dofs + (int64_t)NODES * cell;
    kinematics(s, cell, u, q, &c);
    volume_error(s, &c, e);
    coupling(&c, B);
    for (int m = 0; m < PRESSURES; ++m)
      for (int i = 0; i < 3; ++i)
        for (int a = 0; a < NODES; ++a) e[m] += B[m][PADDED * i + a] * du[3 * (int64_t)blocks[a] + i];
    forward_substitution(c.M, e);
    backward_substitution(c.M, e);
    for (int m = 0; m < PRESSURES; ++m) dq[PRESSURES * (int64_t)cell + m] = s->kappa * e[m];
  }
}

/* Entries b >= from of row (a, i), (j, b) of the tangent; `from` is known when this is compiled, so the sums stay in
   registers. T (27, 12): gradient of node a's function times D, in places 3 j + L. */
static inline __attribute__((always_inline)) void tangent_row(const cell_t* c, double T[POINTS][WIDE],
                                                              double B[PRESSURES][ROW], int a, int i, int j,
                                                              const int from, double* row)
{
  double sum[PADDED] __attribute__((aligned(64))) = {0};
  for (int t = 0; t < POINTS; ++t)
    for (int L = 0; L < 3; ++L) {
      const double f = T[t][3 * j + L];
      for (int b = from; b < PADDED; ++b) sum[b] += f * c->G[3 * t + L][b];
    }
  for (int m = 0; m < PRESSURES; ++m) {
    const double f = B[m][PADDED * i + a];
    for (int b = from; b < PADDED; ++b) sum[b] += f * B[m][PADDED * j + b];
  }
  memcpy(row + from, sum + from, (PADDED - from) * sizeof(double));
}

/* Condensed tangent of a cell, K[a][3 i + j][b] for b >= a, and condensed force g. */
static void tangent(const solid_t* s, int cell, const double* u, const double* q, double K[NODES][9][PADDED],
                    double g[ROW])
{
  cell_t c;
  double result[LAW], D[POINTS][9][WIDE], B[PRESSURES][ROW], e[PRESSURES];
  double T[3][POINTS][WIDE] __attribute__((aligned(64)));
  kinematics(s, cell, u, q, &c);
  memset(g, 0, ROW * sizeof(double));
  for (int t = 0; t < POINTS; ++t) {
    evaluate(s, &c, t, result);
    add_forces(&c, t, result, g);
    const double* entry = result + 9;
    for (int i = 0; i < 9; ++i)
      for (int j = i; j < 9; ++j) D[t][i][j] = D[t][j][i] = c.volume[t] * *entry++;
    for (int i = 0; i < 9; ++i) memset(D[t][i] + 9, 0, (WIDE - 9) * sizeof(double));
  }
  volume_error(s, &c, e);
  coupling(&c, B);
  /* Y = sqrt(kappa) L^-1 B and y = sqrt(kappa) L^-1 e, so that the volumetric parts are Y^T Y and Y^T y */
  const double root = sqrt(s->kappa);
  forward_substitution(c.M, e);
  for (int m = 0; m < PRESSURES; ++m) e[m] *= root;
  for (int m = 0; m < PRESSURES; ++m) {
    for (int k = 0; k < m; ++k)
      for (int n = 0; n < ROW; ++n) B[m][n] -= c.M[m][k] * B[k][n];
    for (int n = 0; n < ROW; ++n) B[m][n] /= c.M[m][m];
  }
  for (int m = 0; m < PRESSURES; ++m)
    for (int n = 0; n < ROW; ++n) B[m][n] *= root;
  for (int m = 0; m < PRESSURES; ++m)
    for (int n = 0; n < ROW; ++n) g[n] += B[m][n] * e[m];
  for (int a = 0; a < NODES; ++a) {
    for (int t = 0; t < POINTS; ++t)
      for (int i = 0; i < 3; ++i)
        for (int jL = 0; jL < WIDE; ++jL)
          T[i][t][jL] = c.G[3 * t][a] * D[t][3 * i][jL] + c.G[3 * t + 1][a] * D[t][3 * i + 1][jL]
                        + c.G[3 * t + 2][a] * D[t][3 * i + 2][jL];
    for (int i = 0; i < 3; ++i)
      for (int j = 0; j < 3; ++j) {
        double* row = K[a][3 * i + j];
        switch (a / 4) {
          case 0: tangent_row(&c, T[i], B, a, i, j, 0, row); break;
          case 1: tangent_row(&c, T[i], B, a, i, j, 4, row); break;
          case 2: tangent_row(&c, T[i], B, a, i, j, 8, row); break;
          case 3: tangent_row(&c, T[i], B, a, i, j, 12, row); break;
          case 4: tangent_row(&c, T[i], B, a, i, j, 16, row); break;
          case 5: tangent_row(&c, T[i], B, a, i, j, 20, row); break;
          default: tangent_row(&c, T[i], B, a, i, j, 24, row);
        }
      }
  }
}

/* Full element matrices (last - first, 81, 81) and condensed forces (last - first, 81), dof 3 a + i. */
void solid_matrices(const solid_t* s, int32_t first, int32_t last, const double* u, const double* q, double* matrices,
                    double* forces)
{
  double K[NODES][9][PADDED] __attribute__((aligned(64))), g[ROW] __attribute__((aligned(64)));
  for (int cell = first; cell < last; ++cell) {
    double* out = matrices + (int64_t)(cell - first) * DOFS * DOFS;
    tangent(s, cell, u, q, K, g);
    for (int a = 0; a < NODES; ++a)
      for (int i = 0; i < 3; ++i) {
        forces[(int64_t)(cell - first) * DOFS + 3 * a + i] = g[PADDED * i + a];
        for (int b = a; b < NODES; ++b)
          for (int j = 0; j < 3; ++j)
            out[(3 * a + i) * DOFS + 3 * b + j] = out[(3 * b + j) * DOFS + 3 * a + i] = K[a][3 * i + j][b];
      }
  }
}

/* Upper triangle of the assembled tangent, in compressed rows `values` that start at `rows`, and minus the force.
   place (n_cells, 27, 27), for b >= a: which block of its block row. Fixed dofs move by `jump`; what that
   does to the others goes to the right-hand side, their own rows and columns are left empty. */
void solid_assemble(const solid_t* s, const double* u, const double* q, const int64_t* rows, const int32_t* place,
                    const uint8_t* fixed, const double* jump, double* values, double* rhs)
{
  double K[NODES][9][PADDED] __attribute__((aligned(64))), g[ROW] __attribute__((aligned(64)));
  for (int cell = 0; cell < s->n_cells; ++cell) {
    const int32_t* blocks = s->dofs + (int64_t)NODES * cell;
    const int32_t* where = place + (int64_t)NODES * NODES * cell;
    tangent(s, cell, u, q, K, g);
    for (int a = 0; a < NODES; ++a) {
      const int64_t A = blocks[a];
      for (int i = 0; i < 3; ++i)
        if (!fixed[3 * A + i]) rhs[3 * A + i] -= g[PADDED * i + a];
      for (int b = a; b < NODES; ++b) {
        const int64_t C = blocks[b], k = where[a * NODES + b];
        for (int i = 0; i < 3; ++i)
          for (int j = a == b ? i : 0; j < 3; ++j) {
            const int64_t r = 3 * A + i, t = 3 * C + j;
            const double value = K[a][3 * i + j][b];
            if (fixed[r] || fixed[t]) {
              if (!fixed[r]) rhs[r] -= value * jump[t];
              if (!fixed[t]) rhs[t] -= value * jump[r];
            } else
              values[A <= C ? rows[r] + 3 * k + j - i : rows[t] + 3 * k + i - j] += value;
          }
      }
    }
  }
}

/* y (n) = A x with the symmetric A given by its upper triangle in compressed rows, columns rising. */
void symmetric_product(int32_t n, const int32_t* rows, const int32_t* columns, const double* values, const double* x,
                       double* y)
{
  memset(y, 0, n * sizeof(double));
  for (int i = 0; i < n; ++i) {
    double sum = values[rows[i]] * x[i];
    for (int k = rows[i] + 1; k < rows[i + 1]; ++k) {
      sum += values[k] * x[columns[k]];
      y[columns[k]] += values[k] * x[i];
    }
    y[i] += sum;
  }
}
