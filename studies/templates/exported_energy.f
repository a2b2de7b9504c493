      SUBROUTINE EQGAPW(A1, A2, D)
!     D = W, W1, W2, W11, W12, W22 at the isochoric invariants A1, A2
      IMPLICIT NONE
      DOUBLE PRECISION A1, A2, D(6), X, Y, Z
      INTEGER K
      DO K = 1, 6
        D(K) = 0.0D0
      END DO
{% for term in terms %}
{% if term is power %}
      Z = {{ term.shift | fortran }}
      Y = {{ term.exponent | fortran }}
      X = {{ term.coefficient | fortran }}
      CALL EQPOWR(A{{ term.invariant }}, Z, Y, X, {{ term.invariant }}, D)
{% elif term is spline %}
      CALL EQSPL{{ loop.index }}(A{{ term.invariant }}, D)
{% else %}
      CALL EQNET{{ loop.index }}(A1, A2, D)
{% endif %}
{% endfor %}
      END

      SUBROUTINE EQPOWR(A, SHIFT, P, C, KIND, D)
!     adds C ((A - SHIFT)**P - (3 - SHIFT)**P)
      IMPLICIT NONE
      DOUBLE PRECISION A, SHIFT, P, C, D(6), X, R
      INTEGER KIND
      X = A - SHIFT
      R = 3.0D0 - SHIFT
      IF (SHIFT .EQ. 3.0D0) THEN
        X = MAX(X, 0.0D0)
      END IF
      IF (P .EQ. 1.0D0) THEN
        D(1) = D(1) + C*(X - R)
        D(1 + KIND) = D(1 + KIND) + C
        RETURN
      END IF
      D(1) = D(1) + C*X**P
      IF (R .GT. 0.0D0) D(1) = D(1) - C*R**P
      D(1 + KIND) = D(1 + KIND) + C*P*X**(P - 1.0D0)
      IF (P .EQ. 2.0D0) THEN
        D(2*KIND + 2) = D(2*KIND + 2) + 2.0D0*C
        RETURN
      END IF
      R = C*P*(P - 1.0D0)*X**(P - 2.0D0)
      D(2*KIND + 2) = D(2*KIND + 2) + R
      END
{% for term in terms %}
{% if term is spline %}

      SUBROUTINE EQSPL{{ loop.index }}(A, D)
!     adds the integral of a cubic spline of sqrt((J - J0)/TOP)
      IMPLICIT NONE
      INTEGER M, I
      PARAMETER (M = {{ term.pieces | length }})
      DOUBLE PRECISION A, D(6), TOP, X, S, T, Q, W, W1, W2, G, H
      DOUBLE PRECISION C(4, M), E(M + 1)
{% for row in term.pieces %}{% set i = loop.index %}
{% for value in row %}
      DATA C({{ loop.index }}, {{ i }}) /{{ value | fortran }}/
{% endfor %}
{% endfor %}
{% for value in term.energies %}
      DATA E({{ loop.index }}) /{{ value | fortran }}/
{% endfor %}
      TOP = {{ term.top | fortran }}
{% if term.invariant == 1 %}
      X = A - 3.0D0
{% else %}
      X = A**1.5D0 - 3.0D0**1.5D0
{% endif %}
      S = SQRT(MIN(MAX(X/TOP, 1.0D-12), 1.0D0))
      I = MIN(INT(S*M), M - 1)
      T = S*M - I
      I = I + 1
      W1 = C(1,I) + T*(C(2,I) + T*(C(3,I) + T*C(4,I)))
      W2 = C(2,I) + T*(2.0D0*C(3,I) + 3.0D0*T*C(4,I))
      W2 = W2*M/(2.0D0*TOP*S)
      Q = C(1,I) + T*(C(2,I)/2.0D0 + T*(C(3,I)/3.0D0 + T*C(4,I)/4.0D0))
      Q = Q*(I - 1)
      W = C(2,I)/3.0D0 + T*(C(3,I)/4.0D0 + T*C(4,I)/5.0D0)
      W = E(I) + 2.0D0*TOP/M**2*T*(Q + T*(C(1,I)/2.0D0 + T*W))
      IF (X .LT. 1.0D-12*TOP) THEN
        W = W1*X
        W2 = 0.0D0
      END IF
      IF (X .GT. TOP) THEN
        W = E(M + 1) + W1*(X - TOP)
        W2 = 0.0D0
      END IF
{% if term.invariant == 1 %}
      G = 1.0D0
      H = 0.0D0
{% else %}
      G = 1.5D0*SQRT(A)
      H = 0.75D0/SQRT(A)
{% endif %}
      D(1) = D(1) + W
      D({{ 1 + term.invariant }}) = D({{ 1 + term.invariant }}) + W1*G
      D({{ 2 + 2 * term.invariant }}) = D({{ 2 + 2 * term.invariant }}) + W2*G*G + W1*H
      END
{% elif not term is power %}

      SUBROUTINE EQNET{{ loop.index }}(A1, A2, D)
!     adds a network of convex layers: weights by rows, biases; output, skip
      IMPLICIT NONE
      INTEGER NIN, NL, NP, NMAX, L, I, J, K, N, AT
      PARAMETER (NIN = {{ term.invariants | length }}, NL = {{ term.layers | length }})
      PARAMETER (NP = {{ term.values | length }})
      PARAMETER (NMAX = {{ (term.layers | max, 2) | max }})
      INTEGER LAYER(NL)
      DOUBLE PRECISION A1, A2, D(6), P(NP), X(2), X1(2), X2(2), SC
      DOUBLE PRECISION Z(NMAX), G(NMAX, 2), H(NMAX, 3), Z0(NMAX)
      DOUBLE PRECISION ZN(NMAX), GN(NMAX, 2), HN(NMAX, 3), Z0N(NMAX)
      DOUBLE PRECISION V, V0, VG(2), VH(3), E, S1, S2
{% for width in term.layers %}
      DATA LAYER({{ loop.index }}) /{{ width }}/
{% endfor %}
{% for value in term.values %}
      DATA P({{ loop.index }}) /{{ value | fortran }}/
{% endfor %}
{% for invariant in term.invariants %}{% set i = loop.index %}
      SC = {{ term.scales[loop.index0] | fortran }}
{% if invariant == 1 %}
      X({{ i }}) = SC*(A1 - 3.0D0)
      X1({{ i }}) = SC
      X2({{ i }}) = 0.0D0
{% else %}
      X({{ i }}) = SC*(A2**1.5D0 - 3.0D0**1.5D0)
      X1({{ i }}) = SC*1.5D0*SQRT(A2)
      X2({{ i }}) = SC*0.75D0/SQRT(A2)
{% endif %}
{% endfor %}
      DO I = 1, NIN
        Z(I) = X(I)
        Z0(I) = 0.0D0
        DO K = 1, 3
          IF (K .LT. 3) G(I, K) = 0.0D0
          H(I, K) = 0.0D0
        END DO
        G(I, I) = X1(I)
        H(I, 2*I - 1) = X2(I)
      END DO
      N = NIN
      AT = 0
      DO L = 1, NL
        DO I = 1, LAYER(L)
          V = P(AT + LAYER(L)*N + I)
          V0 = V
          J = AT + (I - 1)*N + 1
          CALL EQDOTS(N, NMAX, P(J), Z, G, H, Z0, V, V0, VG, VH)
          E = EXP(-ABS(V))
          ZN(I) = MAX(V, 0.0D0) + LOG(1.0D0 + E)
          Z0N(I) = MAX(V0, 0.0D0) + LOG(1.0D0 + EXP(-ABS(V0)))
          S1 = 1.0D0/(1.0D0 + EXP(-V))
          S2 = E/(1.0D0 + E)**2
          GN(I, 1) = S1*VG(1)
          GN(I, 2) = S1*VG(2)
          HN(I, 1) = S1*VH(1) + S2*VG(1)**2
          HN(I, 2) = S1*VH(2) + S2*VG(1)*VG(2)
          HN(I, 3) = S1*VH(3) + S2*VG(2)**2
        END DO
        AT = AT + LAYER(L)*(N + 1)
        N = LAYER(L)
        DO I = 1, N
          Z(I) = ZN(I)
          Z0(I) = Z0N(I)
          DO J = 1, 3
            IF (J .LT. 3) G(I, J) = GN(I, J)
            H(I, J) = HN(I, J)
          END DO
        END DO
      END DO
      V = 0.0D0
      V0 = 0.0D0
      CALL EQDOTS(N, NMAX, P(AT + 1), Z, G, H, Z0, V, V0, VG, VH)
      SC = {{ term.energy_scale | fortran }}
      V = V - V0
      DO I = 1, NIN
        V = V + P(AT + N + I)*X(I)
        VG(I) = VG(I) + P(AT + N + I)*X1(I)
        VH(2*I - 1) = VH(2*I - 1) + P(AT + N + I)*X2(I)
      END DO
      D(1) = D(1) + SC*V
{% if term.invariants == (2,) %}
      D(3) = D(3) + SC*VG(1)
      D(6) = D(6) + SC*VH(1)
{% else %}
      D(2) = D(2) + SC*VG(1)
      D(4) = D(4) + SC*VH(1)
{% if term.invariants | length == 2 %}
      D(3) = D(3) + SC*VG(2)
      D(5) = D(5) + SC*VH(2)
      D(6) = D(6) + SC*VH(3)
{% endif %}
{% endif %}
      END
{% endif %}
{% endfor %}

      SUBROUTINE EQDOTS(N, M, W, Z, G, H, Z0, V, V0, VG, VH)
!     V + W.Z, V0 + W.Z0, W.G, W.H
      IMPLICIT NONE
      INTEGER N, M, J
      DOUBLE PRECISION W(N), Z(M), G(M, 2), H(M, 3), Z0(M)
      DOUBLE PRECISION V, V0, VG(2), VH(3)
      VG(1) = 0.0D0
      VG(2) = 0.0D0
      VH(1) = 0.0D0
      VH(2) = 0.0D0
      VH(3) = 0.0D0
      DO J = 1, N
        V = V + W(J)*Z(J)
        V0 = V0 + W(J)*Z0(J)
        VG(1) = VG(1) + W(J)*G(J, 1)
        VG(2) = VG(2) + W(J)*G(J, 2)
        VH(1) = VH(1) + W(J)*H(J, 1)
        VH(2) = VH(2) + W(J)*H(J, 2)
        VH(3) = VH(3) + W(J)*H(J, 3)
      END DO
      END
