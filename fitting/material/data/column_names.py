"""The names that columns go by: in plain English words, and by the quantity that they mean."""

import re
from typing import NamedTuple


def _pairs(text: str) -> dict[str, str]:
    """Words and what they mean, from a text such as "kraft=force weg=travel"."""
    return dict(re.findall(r"(\S+)=(\S+)", text))


# German, French, Italian, Spanish, Portuguese, Dutch, Scandinavian, Polish, Czech, Turkish,
# Russian, Chinese, Japanese and Korean words, spelled without accents, the longest of alike
# ones first; in the last three blanks part no words.
_WORDS = _pairs(
    """
    standardkraft=standard_force pruefkraft=test_force zugkraft=tensile_force
    zuglast=tensile_load zugverlaengerung=tensile_extension zugdehnung=tensile_strain
    maschinenweg=machine_travel traverse=crosshead feindehnung=extensometer
    ab_vorkraft=from_preload
    druckkraft=compressive_force kraft=force standardweg=standard_travel
    traversenweg=crosshead_travel kolbenweg=actuator_travel verlaengerung=extension
    laengenaenderung=extension verformung=extension verschiebung=displacement weg=travel
    wahre_dehnung=true_strain technische_dehnung=nominal_strain nenndehnung=nominal_strain
    stauchung=compressive_strain dehnung=strain wahre_spannung=true_stress
    technische_spannung=nominal_stress nennspannung=nominal_stress zugspannung=tensile_stress
    druckspannung=compressive_stress schubspannung=shear_stress spannung=stress
    streckverhaeltnis=stretch volumenverhaeltnis=volume_ratio volumendehnung=volumetric_strain
    volumenaenderung=volume_change volumenstauchung=volumetric_compression ueberdruck=pressure
    innendruck=pressure druck=pressure pruefzeit=test_time versuchszeit=test_time zeit=time
    zyklus=cycle anfangsquerschnitt=initial_area querschnittsflaeche=area querschnitt=area
    bei_startposition=at_start_position einspannlaenge=grip_separation
    klemmlaenge=clamping_length anfangsmesslaenge=gauge_length messlaenge=gauge_length
    bezugslaenge=gauge_length anfangslaenge=initial_length
    probenhoehe=specimen_height probenlaenge=specimen_length
    probendicke=specimen_thickness dicke=thickness
    probenbreite=specimen_width breite=width probendurchmesser=specimen_diameter
    durchmesser=diameter hoehe=height

    charge_de_traction=tensile_load charge_de_compression=compressive_load
    allongement=elongation deplacement_de_la_traverse=crosshead_displacement
    deplacement_traverse=crosshead_displacement deplacement=displacement
    extension_en_traction=tensile_extension deformation_en_traction=tensile_strain
    deformation_en_compression=compressive_strain deformation_vraie=true_strain
    deformation_nominale=nominal_strain deformation=strain
    contrainte_de_traction=tensile_stress contrainte_en_traction=tensile_stress
    contrainte_de_compression=compressive_stress contrainte_en_compression=compressive_stress
    contrainte_vraie=true_stress contrainte_nominale=nominal_stress contrainte=stress
    pression=pressure rapport_de_volume=volume_ratio epaisseur=thickness largeur=width
    course=travel effort=force longueur_initiale=initial_length longueur_de_jauge=gauge_length
    longueur_utile=gauge_length longueur_entre_mors=grip_separation longueur=length
    section_initiale=initial_area diametre=diameter temps=time

    forza=force carico=load spostamento=displacement corsa=travel allungamento=elongation
    deformazione_vera=true_strain deformazione_reale=true_strain
    deformazione_nominale=nominal_strain deformazione=strain tensione_vera=true_stress
    tensione_reale=true_stress tensione_nominale=nominal_stress tensione=stress
    sforzo_nominale=nominal_stress sforzo=stress pressione=pressure larghezza=width
    spessore=thickness lunghezza_utile=gauge_length lunghezza_iniziale=initial_length
    lunghezza=length diametro=diameter
    altezza=height tempo=time
    sezione_iniziale=initial_area sezione=area tratto_utile=gauge_length

    tension_de_traccion=tensile_stress deformacion_por_traccion=tensile_strain
    longitud_de_calibre=gauge_length fuerza=force carga=load desplazamiento=displacement
    recorrido=travel
    alargamiento=elongation deformacion_verdadera=true_strain deformacion_real=true_strain
    deformacion_nominal=nominal_strain deformacion=strain tension_verdadera=true_stress
    tension_real=true_stress tension_nominal=nominal_stress esfuerzo_verdadero=true_stress
    esfuerzo_real=true_stress esfuerzo_nominal=nominal_stress esfuerzo=stress presion=pressure
    seccion=area ancho=width espesor=thickness longitud_inicial=initial_length longitud=length
    altura=height tiempo=time

    forca=force deslocamento=displacement alongamento=elongation extensao=extension
    deformacao_verdadeira=true_strain deformacao_real=true_strain
    deformacao_nominal=nominal_strain deformacao=strain tensao_verdadeira=true_stress
    tensao_real=true_stress tensao_nominal=nominal_stress tensao=stress pressao=pressure
    largura=width espessura=thickness comprimento_inicial=initial_length comprimento=length

    trekkracht=tensile_force drukkracht=compressive_force kracht=force
    verplaatsing=displacement verlenging=extension ware_rek=true_strain
    nominale_rek=nominal_strain rek=strain ware_spanning=true_stress
    nominale_spanning=nominal_stress trekspanning=tensile_stress
    drukspanning=compressive_stress spanning=stress druk=pressure breedte=width
    dikte=thickness meetlengte=gauge_length beginlengte=initial_length hoogte=height tijd=time

    foerlaengning=elongation forlaengelse=elongation forlengelse=elongation
    foerskjutning=displacement forskydning=displacement forskyvning=displacement
    dragkraft=tensile_force trykkraft=compressive_force tryckkraft=compressive_force
    belastning=load toejning=strain toeyning=strain dragspaenning=tensile_stress
    spaenning=stress spaending=stress spenning=stress maetlaengd=gauge_length
    nominelle=nominal nominell=nominal nominel=nominal sann=true
    ursprungslaengd=initial_length laengd=length laengde=length lengde=length
    tjocklek=thickness tykkelse=thickness bredd=width bredde=width hoejd=height
    hoejde=height hoeyde=height tryck=pressure tryk=pressure trykk=pressure tid=time

    sila_rozciagajaca=tensile_force sila_sciskajaca=compressive_force sila=force
    obciazenie=load przemieszczenie_trawersy=crosshead_displacement
    przemieszczenie=displacement droga=travel wydluzenie_wzgledne=strain wydluzenie=elongation
    odksztalcenie_rzeczywiste=true_strain odksztalcenie_inzynierskie=nominal_strain
    odksztalcenie_nominalne=nominal_strain odksztalcenie=strain
    naprezenie_rzeczywiste=true_stress naprezenie_inzynierskie=nominal_stress
    naprezenie_nominalne=nominal_stress naprezenie=stress cisnienie=pressure czas=time
    dlugosc_pomiarowa=gauge_length baza_pomiarowa=gauge_length
    dlugosc_poczatkowa=initial_length dlugosc=length grubosc=thickness szerokosc=width
    srednica=diameter wysokosc=height pole_przekroju=area przekroj=area

    tahova_sila=tensile_force tlakova_sila=compressive_force zatizeni=load
    posuv_pricniku=crosshead_displacement posuv=displacement posunuti=displacement
    draha=travel pomerne_prodlouzeni=strain prodlouzeni=elongation
    skutecna_deformace=true_strain smluvni_deformace=nominal_strain deformace=strain
    skutecne_napeti=true_stress smluvni_napeti=nominal_stress napeti=stress tlak=pressure
    merna_delka=gauge_length pocatecni_delka=initial_length delka=length tloustka=thickness
    sirka=width prumer=diameter vyska=height cas=time

    cekme_kuvveti=tensile_force basma_kuvveti=compressive_force kuvvet=force yuek=load
    yer_degistirme=displacement deplasman=displacement birim_uzama=strain
    yuezde_uzama=strain uzama=elongation gercek_gerinim=true_strain gerinim=strain
    birim_sekil_degistirme=strain gercek_gerilme=true_stress cekme_gerilmesi=tensile_stress
    muehendislik_gerilmesi=nominal_stress gerilme=stress basinc=pressure zaman=time
    oelcue_boyu=gauge_length ilk_boy=initial_length kalinlik=thickness genislik=width
    yuekseklik=height kesit_alani=area

    растягивающее_усилие=tensile_force усилие=force сила=force нагрузка=load
    перемещение_траверсы=crosshead_displacement перемещение=displacement ход=travel
    относительное_удлинение=strain относительная_деформация=strain удлинение=elongation
    истинная_деформация=true_strain инженерная_деформация=nominal_strain деформация=strain
    истинное_напряжение=true_stress условное_напряжение=nominal_stress
    инженерное_напряжение=nominal_stress номинальное_напряжение=nominal_stress
    напряжение=stress давление=pressure время=time рабочая_длина=gauge_length
    расчетная_длина=gauge_length начальная_длина=initial_length длина=length
    толщина=thickness ширина=width диаметр=diameter высота=height
    площадь_поперечного_сечения=area площадь_сечения=area площадь=area

    拉伸=tensile_ 引張=tensile_ 拉力=tensile_force 压缩=compressive_ 圧縮=compressive_
    原始=initial_ 初期長さ=initial_length 試験片=specimen_ 夹头=crosshead_ 横梁=crosshead_
    クロスヘッド=crosshead_ 引伸计=extensometer 力值=force ロードセル=load_cell 行程=stroke
    伸长率=strain 伸び率=strain 試験応力=stress 公称ひずみ=nominal_strain 歪み=strain 歪=strain
    夹具间距=grip_separation つかみ間隔=grip_separation つかみ具間距離=grip_separation
    横截面积=area 截面积=area 厚み=thickness
    试验力=test_force 試験力=test_force 试验=test_ 試験=test_ 高さ=height
    载荷=load 负荷=load 荷重=load 真应力=true_stress
    真応力=true_stress 工程应力=nominal_stress 名义应力=nominal_stress 公称応力=nominal_stress
    应力=stress 応力=stress 真应变=true_strain 工程应变=nominal_strain 名义应变=nominal_strain
    应变=strain ひずみ=strain 位移=displacement 変位=displacement 变形=extension
    伸长=elongation 伸び=elongation ストローク=stroke 压力=pressure 圧力=pressure 时间=time
    時間=time 标距=gauge_length 標点間距離=gauge_length
    標線間距離=gauge_length 標点距離=gauge_length チャック間距離=grip_separation
    宽度=width 厚度=thickness 厚さ=thickness 直径=diameter 面积=area 断面積=area 高度=height
    力=force 幅=width

    인장=tensile_ 압축=compressive_ 신율=strain 시험력=test_force 하중=load
    변위=displacement 신장=elongation 진응력=true_stress
    공칭응력=nominal_stress 응력=stress 진변형률=true_strain 공칭변형률=nominal_strain
    변형률=strain 압력=pressure 시간=time 표점거리=gauge_length 너비=width 두께=thickness
    직경=diameter 단면적=area 높이=height 힘=force 폭=width
    """
)
EASTERN_WORDS = tuple(word for word in _WORDS if len(word) > 1 and word > "\u3000")
"""Words of tests by which an eastern text's code page is known."""
_ACCENTS = str.maketrans(
    "éèêàáíóúùìòãõâôçąćęłńśźżčďěňřšťůýžığşåё",
    "eeeaaiouuioaoaocacelnszzcdenrstuyzigsaе",
    "\u0307",  # what is left of a capital dotted i
) | str.maketrans({"ä": "ae", "ö": "oe", "ü": "ue", "ß": "ss", "æ": "ae", "ø": "oe"})
_FOREIGN = re.compile(rf"(?<![a-zа-я])(?:{'|'.join(_WORDS)})(?![a-zа-я])")

_RUSSIAN_UNITS = _pairs(
    "па=Pa кпа=kPa мпа=MPa гпа=GPa н=N кн=kN кгс=kgf гс=gf бар=bar мкм=um мм=mm см=cm м=m "
    "мс=ms с=s сек=s мин=min ч=h град=deg"
)
_RUSSIAN_UNIT = re.compile(
    rf"(?i)(?<![а-яё])(?:{'|'.join(_RUSSIAN_UNITS)})(?=\s*(?:[\])}},;/|²^23\"'\t]|$))",
    re.MULTILINE,
)


def with_latin_units(text: str) -> str:
    """A text with Russian spellings of units, at the end of a cell or in brackets, in Latin."""
    if re.search("[А-я]", text) is None:  # which takes a hundredth of the time
        return text
    return _RUSSIAN_UNIT.sub(lambda found: _RUSSIAN_UNITS[found.group().casefold()], text)


def words_known(text: str) -> int:
    """How many words of tests stand in a text, whatever the language."""
    return len(_FOREIGN.findall(_spelled(text)))


def _spelled(text: str) -> str:
    """A text in lower case, without accents, words joined by underscores."""
    text = text.casefold().translate(_ACCENTS)
    return re.sub(r"[\s\-.:,;\"']+", "_", text).strip("_")


def plain_words(text: str) -> str:
    """A name in English, lower case, without accents, words joined by underscores."""
    text = re.sub(r"(?<=[a-z])(?=[A-Z][a-z])(?!Pa)", "_", text.strip())
    text = re.sub("试样|(?<![a-z])sample_", "specimen_", _spelled(text))
    return _FOREIGN.sub(lambda found: _WORDS[found.group()], text)


class Quantity(NamedTuple):
    """What a column can measure."""

    name: str  # how this project calls it
    dimension: str  # kind of unit; "area" is a length squared, "word" has none
    pattern: str  # regular expression of its names, blanks as underscores


# Name, dimension and pattern; a line that is indented further goes on with the pattern. The
# first quantity whose pattern a name begins with is meant.
_TABLE = r"""
cauchy_difference stress (?:cauchy|true)_stress_difference_(?:22_minus_11|2_minus_1)
cauchy_difference_reversed stress (?:cauchy|true)_stress_difference_(?:11_minus_22|1_minus_2)
sigma_displacement length (?:sigma|noise|uncertainty|std)_displacement
sigma_force force (?:sigma|noise|uncertainty|std)_force
depth length (?:loads_0_)?(?:indentation_)?depth|indentation
sigma stress (?!sigma_(?:eng|nom|true|cauchy)[a-z]*(?!_stress|[a-z]))
    (?:sigma|noise|uncertainty|std|stdev|standard_deviation|error)
    (?:_(?:nominal|cauchy|engineering|true))?(?:_stress)?(?:_(?:oil_)?pressure)?
nominal_shear stress (?:nominal_|engineering_|cauchy_)?shear_stress|tau|τ
cauchy stress (?:cauchy|true|kirchhoff)_?stress
    |(?:stress|sigma|σ)_(?:cauchy|true)
second_pk stress (?:second_piola_kirchhoff|pk2|2nd_pk|second_pk)(?:_stress)?
nominal stress (?:nominal|engineering|eng|first_piola_kirchhoff|pk1|1st_pk|first_pk|tensile
    |compressive|compression|standard)_?stress|pk1|first_piola_kirchhoff|p_?11
    |(?:stress|sigma|σ)_(?:eng|engineering|nom|nominal)
stress stress (?:axial_)?stress|σ
pressure pressure (?:inflation_|gauge_|differential_|oil_|hydrostatic_|confining_|chamber_
    |internal_|inner_|applied_|balloon_)*pressure|p
force force (?:axial_|ax_|static_|standard_|tensile_|tension_|compressive_|compression_|test_
    |shear_|normal_|applied_|load_cell_)*(?:force|load)(?:_cell)?
    |(?:f|last|charge|reading)(?=_[mk]?n$|$)
time time (?:test_|running_|total_|elapsed_|step_)*time|t(?=_s$|_min$|$)
cycle number (?:total_|elapsed_)?cycles?(?:_(?:count|number|no))?
volume_ratio number (?:relative_)?volume_(?:ratio|stretch)|relative_volume|v/v_?[0o]|jacobian|j
volumetric_compression number (?:volumetric|volume)_(?:compression|reduction|loss)
    |compressive_(?:volumetric|volume)_strain
volumetric_strain number (?:volumetric|volume|bulk)_strain|(?:relative_)?volume_change
    |dilatation|dv/v_?[0o]?
shear_angle angle shear_angle
shear number shear_strain|amount_of_shear|shear|gamma|γ
log_strain number (?:log|true|hencky|logarithmic|natural|ln)_?strain
    |(?:strain|eps|epsilon|ε)_(?:log|true|hencky|logarithmic)
    |e(?:xx|yy|[12])_\[1\]_hencky
green_strain number green(?:_lagrange)?_?strain|e(?:xx|yy|[12])_\[1\]_lagrange
strain number (?:nominal_|engineering_|eng_|tensile_|compressive_|compression_|axial_|standard_
    |corrected_|extensometer_|technical_|stroke_|crosshead_|displacement_)*strain(?:_from_preload)?
    |elongation_percent|ε
    |(?:strain|eps|epsilon|ε)_(?:eng|engineering|nom|nominal)
    |(?:section_\d+_|point_\d+_|mean_)?epsilon|e(?:xx|yy|[12])_\[1\]_(?:biot|engineering)
stretch number (?:hoop_)?stretch(?:_ratio)?|extension_ratio|lambda|λ|lam|f_?11
displacement length (?:crosshead_|cross_head_|loads_0_|axial_|ax_|standard_|tensile_
    |compressive_|actuator_|corrected_|extensometer_|video_|machine_|shear_)*(?:displacement|displ?
    |extension|elong(?:ation)?|compression|stroke|travel|deflection|crosshead|distance|position
    |extensometer)(?:_extensometer)?(?:_from_preload)?
    |d(?:elta_)?l|δl
current_length length (?:axial_|plate_)?gap|current_length
grip_separation length (?:initial_)?(?:grip|jaw|clamp)(?:_to_(?:grip|jaw|clamp))?
    _(?:separation|distance|length)(?:_at_(?:the_)?start(?:_position)?)?(?:_l?[0o])?
    |clamping_length(?:_l?[0o])?
height length (?:apex_|pole_|bulge_|dome_|specimen_|initial_)*height(?:_h[0o]?)?
    |apex_displacement
length length (?:gauge_|gage_|initial_|original_|specimen_|parallel_)*length(?:_l?[0o])?|l[0o]
    |gau?ge
width length (?:specimen_|plate_|initial_)*width(?:_[bw][0o]?)?|b0|w0
thickness_ratio number thickness_ratio|h_over_r
thickness length (?:specimen_|plate_|wall_|initial_|membrane_)*thickness
    (?:_[abht][0o]?)?|h0|t0
diameter length (?:specimen_|initial_|outer_)*diameter(?:_d[0o]?)?|d0
rest_radius length (?:initial|undeformed|reference|rest)_radius|r0
radius length (?:current_|balloon_|membrane_|diaphragm_)?radius
area area (?:specimen_|initial_|cross_section(?:al)?_)*area(?:_[as][0o]?)?|cross_section|a0|s0
weight number weight
use word use|mask|valid|include
specimen word specimen|sample|specimen_id
"""
QUANTITIES = tuple(
    Quantity(*line.split(maxsplit=2))
    for line in re.sub(r"\n +", "", _TABLE).strip().splitlines()
)
